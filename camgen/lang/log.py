"""Findings, assumptions, losses and facts of one run of a program, each with its first line.

The vocabulary of all languages:

- finding: a line that the controller refuses, that is dangerous, or that is unusual
- assumption: a value or a branch that the text does not determine
- open choice: a branch, loop or case whose condition the text does not determine
- loss: an effect of the program that the motions lack, so that no other machine may run them
- omission: an effect that another machine does without, such as accelerations
- fact: a remark that needs no action
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from camgen.lang.programs import LEVELS, Assumption, Finding, Level, OpenChoice
from camgen.model.errors import make_one_line
from camgen.model.text import counted

#: Characters of an entry. A name in a program may be as long as its file.
_LENGTH_LIMIT = 400
#: Number of findings, and of entries of each other kind. They bound the memory. Beyond them the
#: program is refused, or may not run on another machine.
_FINDING_LIMIT, _ENTRY_LIMIT = 100_000, 5_000
#: End of a finding of a run that took a branch which the text does not determine.
IF_HERE = ", if the program comes here like this"
#: The shifts of a run that takes the default option everywhere.
_DEFAULT: Mapping[int, int] = MappingProxyType({})


class Log:
    """The log of one run. It holds each entry once.

    line: function that returns the number of the line that runs, from 1 through all files.
    shifts: options that the run takes, see `RunRequest.shifts`.
    steps: number of steps of the run.
    is_limited: whether the run ended at a limit, such as that of its steps.
    ran: lines of the steps that the run came to. A step of several lines has its first line here,
        and its last line once it is completed.
    is_uncertain: whether the run took a branch that the text does not determine. After that a line
        that the controller would refuse is a possible finding, not refused.
    assumed: assumptions by key and text.
    facts: first line of each fact, by label and text.
    lost, omitted: first line of each loss and omission, by text.
    """

    def __init__(
        self, line: Callable[[], int] = lambda: 1, shifts: Mapping[int, int] = _DEFAULT
    ) -> None:
        self.line = line
        self.shifts = shifts
        self.steps = 0
        self.is_limited = False
        self.ran: set[int] = set()
        self.is_uncertain = False
        self.assumed: dict[tuple[str, str], Assumption] = {}
        self.facts: dict[str, dict[str, int]] = {}
        self.lost: dict[str, int] = {}
        self.omitted: dict[str, int] = {}
        self.untimed = 0
        self._findings: dict[tuple[int, str], Level] = {}
        self._kinds: set[str] = set()
        self._choices: dict[int, OpenChoice] = {}

    def find(self, level: Level, what: str, *, line: int = 0, once: str = "") -> None:
        """Add a finding of the line that runs, or of another line.

        once: name of a kind of finding. Only the first finding of a kind is added.
        """
        if once in self._kinds:
            return
        if len(self._findings) >= _FINDING_LIMIT:
            what = f"more than {_FINDING_LIMIT:,} findings: the others are not listed"
            self._findings.setdefault((1, what), "refused")
            return
        if once:
            self._kinds.add(once)
        if self.is_uncertain and level == "refused" and not line:
            level, what = "possible", f"{what}{IF_HERE}"
        self._findings.setdefault((line or self.line(), _shorten(what)), level)

    def assume(self, what: str, key: str = "", value: float = 0.0, *, line: int = 0) -> None:
        """Add an assumption.

        key: name under which the user sets another value (``--assume``), empty without one.
        """
        if len(self.assumed) >= _ENTRY_LIMIT:
            what = f"more than {_ENTRY_LIMIT:,} assumptions: the others are not listed"
            self.lost.setdefault(what, line or self.line())
            return
        what = _shorten(what)
        self.assumed.setdefault((key, what), Assumption(line or self.line(), what, key, value))

    def choose(self, what: str, key: str = "", value: float = 0.0) -> None:
        """Add an assumption that determines a branch: all later refusals are uncertain."""
        self.is_uncertain = True
        self.assume(what, key, value)

    def decide(self, what: str, default: int, options: int) -> int:
        """Return the option that the run takes at an open choice in its line, from 0.

        what: the value on which the choice depends.
        default: the default option.
        options: number of options.
        """
        line = self.line()
        if len(self._choices) < _ENTRY_LIMIT:
            self._choices.setdefault(line, OpenChoice(line, _shorten(what), options))
        return (default + self.shifts.get(line, 0)) % options

    def lose(self, what: str, *, line: int = 0) -> None:
        """Add a loss."""
        if len(self.lost) < _ENTRY_LIMIT:
            self.lost.setdefault(_shorten(what), line or self.line())

    def leave_out(self, what: str, key: str = "", *, line: int = 0) -> None:
        """Add a loss and an assumption: the run ignores the line."""
        self.assume(what, key, line=line)
        self.lose(what, line=line)

    def lose_axes(self, what: str, is_moving: bool = True) -> None:
        """Add a loss of motions of external axes, which no program of camgen has.

        is_moving: whether such an axis moves, which takes a time that is not known.
        """
        self.untimed += is_moving
        self.fact("external axes", what)
        self.lose(f"external axes: {what}")

    def omit(self, what: str, *, line: int = 0) -> None:
        """Add an omission."""
        if len(self.omitted) < _ENTRY_LIMIT:
            self.omitted.setdefault(_shorten(what), line or self.line())

    def fact(self, label: str, text: str) -> None:
        """Add a fact."""
        texts = self.facts.setdefault(label, {})
        if len(texts) < _ENTRY_LIMIT:
            texts.setdefault(_shorten(text), self.line())

    def has(self, finding: Finding) -> bool:
        """Return whether the log has a finding of this line and text, of any level."""
        return (finding.line, finding.what) in self._findings

    def copy(self) -> Log:
        """Return an independent log with the same entries."""
        log = Log(self.line, self.shifts)
        log._findings, log._kinds = dict(self._findings), set(self._kinds)
        log.is_uncertain = self.is_uncertain
        log.assumed, log.lost, log.omitted = dict(self.assumed), dict(self.lost), dict(self.omitted)
        log.facts = {label: dict(texts) for label, texts in self.facts.items()}
        return log

    def list_findings(self) -> tuple[Finding, ...]:
        """Return the findings by line, and by level within a line, refusals first."""
        findings = [Finding(level, line, what) for (line, what), level in self._findings.items()]
        return tuple(sorted(findings, key=lambda item: (item.line, LEVELS.index(item.level))))

    def list_assumed(self) -> tuple[Assumption, ...]:
        """Return the assumptions by line."""
        return tuple(sorted(self.assumed.values(), key=lambda item: item.line))

    def list_choices(self) -> tuple[OpenChoice, ...]:
        """Return the open choices in the order of the run, each once."""
        return tuple(self._choices.values())

    def list_facts(self, separator: str, shown: int) -> tuple[tuple[str, str], ...]:
        """Return label and text of the facts.

        separator: text between two facts of one label.
        shown: number of facts that a label lists. The others are counted.
        """
        facts = []
        for label, texts in self.facts.items():
            rest = len(texts) - shown
            more = [f"and {counted(rest, 'more', 'more')}"] if rest > 0 else []
            facts.append((label, separator.join([*list(texts)[:shown], *more])))
        return tuple(facts)

    def list_all(self, separator: str, shown: int) -> dict[str, Any]:
        """Return all entries, as members of `Executed`. The arguments are those of `list_facts`."""
        return {
            "findings": self.list_findings(),
            "assumed": self.list_assumed(),
            "facts": self.list_facts(separator, shown),
            "lost": self.list_lost(),
            "omitted": self.list_omitted(),
            "is_limited": self.is_limited,
            "untimed": self.untimed,
            "choices": self.list_choices(),
            "steps": self.steps,
        }

    def list_lost(self) -> tuple[tuple[int, str], ...]:
        """Return line and text of each loss."""
        return tuple((line, what) for what, line in self.lost.items())

    def list_omitted(self) -> tuple[tuple[int, str], ...]:
        """Return line and text of each omission."""
        return tuple((line, what) for what, line in self.omitted.items())


def _shorten(text: str) -> str:
    return make_one_line(text)[:_LENGTH_LIMIT]
