"""Runs a G-code program: its lines on a machine, and its flow on the engine."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, partial

from msgspec import Struct

from camgen.lang.code import Code, End, Jump, Return, Step
from camgen.lang.flow import Counter, Flow, MachineLanguage, Rules
from camgen.lang.gcode.codes import ORDER, feed, speed_and_tool
from camgen.lang.gcode.machine import Leap, Machine
from camgen.lang.gcode.macros import read_goto, set_then, test_branch, test_loop
from camgen.lang.gcode.motion import move, run_usual
from camgen.lang.gcode.predefined import find_value
from camgen.lang.gcode.third_party import begin, end
from camgen.lang.gcode.words import COMMENT, Line, LineError, Parameters, value_at
from camgen.lang.run import Budget, Ended, Stopped

#: Number of different lines whose words are kept.
_KEPT_LINES = 200
#: Depth of calls, and number of arguments, as in LinuxCNC.
_DEPTH, _MOST_ARGUMENTS = 10, 30
_SPEED = re.compile(r"[sS][ \t]*[-+.0-9\[#]")


def has_speed(lines: Sequence[str]) -> bool:
    """Return whether a line has an S word. Without one the spindle is only switched."""
    return any(("S" in raw or "s" in raw) and _SPEED.search(COMMENT.sub("", raw)) for raw in lines)


class OWord(Struct, frozen=True):
    """One O-word.

    label: number, name in < >, or expression in [ ] of its number.
    word: keyword, such as "if", empty for the number of a program.
    rest: text after the keyword.
    """

    label: str
    word: str
    rest: str


class Macro(Struct):
    """A line of a Fanuc macro.

    raw: the line as it is written.
    word: if, goto, while, do or end.
    number: number of its loop, empty without one.
    rest: text after the condition, which the last evaluation has found.
    """

    raw: str
    word: str
    number: str = ""
    rest: str = ""


class RoundCount(Struct):
    """The variable of a repeat, which no line of the program can see."""

    value: float = 0.0


class Interpreter(MachineLanguage):
    """The run of a program.

    machine: the machine that the lines move.
    """

    faults: type[Exception] = LineError

    def __init__(self, machine: Machine, lines: Sequence[str], code: Code) -> None:
        self.machine = machine
        self.log = machine.log
        self._lines, self._code = lines, code
        self._known = Parameters(partial(find_value, machine))
        self._remembered: dict[str, Line] = {}
        self._budget = Budget(len(lines), machine.bounds.gcode_steps, "gcode_steps")
        # No condition is unknown, so that no number of rounds is guessed.
        self._flow = Flow(self, self._budget, Rules(_DEPTH, rounds=1))
        #: Label of the line to which the subroutine that ends goes back, empty for its call.
        self._back = ""
        #: Numbers of the loops of Fanuc that were entered.
        self._entered: set[str] = set()
        self._is_profile = False
        #: First steps of the subroutines that were called.
        self._called: set[int] = set()
        machine.max_instructions = len(lines) + machine.bounds.gcode_motions
        machine.find_lines, machine.run_lines = self._find_profile, self._run_profile

    def run(self, entry: str = "") -> None:
        """Runs the program to its end, or a subroutine with the arguments that the user gives.

        entry: number or name of the subroutine, empty for the program.
        Raises LineError for a wrong line, unless the machine goes on after it (`Machine.refuse`).
        """
        with suppress(Ended):
            if entry:
                self._run_entry(entry.lower().removeprefix("o").strip("<>"))
            else:
                self._flow.run(self._code)
        line = self.machine.line
        for label, start in self._code.labels.items():
            if label.startswith("sub ") and start not in self._called:
                self.machine.line = self._code.steps[start - 1].line
                self.log.fact("not called", f"o{label[4:]}")
        self.machine.line = line

    def _run_entry(self, name: str) -> None:
        """Runs a subroutine: of O-words by number or name, of another controller by number."""
        m, labels = self.machine, self._code.labels
        keys = (f"sub <{name}>", f"sub {name}", f"o{name}")
        start = next((labels[key] for key in keys if key in labels), None)
        if start is None:
            known = ", ".join(key[4:] for key in labels if key.startswith("sub ")) or "none"
            what = f"there is no subroutine {name[:40]}, which is asked for; the text has {known}"
            m.log.find("refused", what, line=1)
            return
        m.line = self._code.steps[start - 1].line
        arguments = {k: m.given[f"args[{k}]"] for k in range(1, 31) if f"args[{k}]" in m.given}
        if not arguments:
            m.assume(f"{name} has no arguments: #1 to #30 are 0", "args")
        self._enter(start, 1, arguments)
        m.ended = True

    # -- lines ---------------------------------------------------------------------------------

    def run_lines(self, span: range) -> Step | None:
        """Runs lines, from 0. Returns the step that follows from the last one."""
        m, lines = self.machine, self._lines
        at = span.start
        while at < span.stop:
            if m.is_settled():
                after = run_usual(m, lines, at, span.stop)
                self._budget.left -= after - at
                at = m.line = after
                if at == span.stop:
                    break
            m.line, step = at + 1, None
            try:
                self._budget.spend()
                m.check_size()
                step = self._run_line(lines[at])
            except LineError as error:
                self._refuse(error)
            if m.ended:
                return End(m.line)
            if step is not None:
                return step
            at += 1
        return None

    def _run_line(self, raw: str) -> Step | None:
        """Runs a line. Returns the step that follows from it. Raises LineError."""
        m = self.machine
        line = self._remembered.get(raw)
        if line is None:
            text = m.profile.clean(m, raw)
            if "%" in raw and raw.strip() == "%":
                m.ended, m.opened = m.opened, True
                return None
            line = m.profile.parse(m, text, self._known)
            # Many lines repeat. A line with parameters has other values each time.
            if "#" not in text and len(self._remembered) < _KEPT_LINES:
                self._remembered[raw] = line
        m.leap = None
        _execute(m, line[0].copy(), line[1].copy())
        return self._leap(m.leap) if m.leap else None

    def _refuse(self, error: LineError) -> None:
        if self._is_profile:
            raise error
        self.machine.refuse(error)

    # -- profiles of lathes --------------------------------------------------------------------

    def _find_profile(self, first: float | None, last: float) -> range:
        """The steps of a profile. Raises LineError.

        first, last: numbers of its blocks. Without `first`, `last` is the label of a subroutine.
        """
        if first is not None:
            start = self._find_step(f"n{first:.0f}")
            return range(start, self._find_next(self._find_step(f"n{last:.0f}")))
        labels = self._code.labels
        if f"sub {last:.0f}" not in labels:
            raise LineError(f"O{last:.0f} is not in this file: the profile of the cycle")
        return range(labels[f"sub {last:.0f}"], labels[f"endsub {last:.0f}"])

    def _run_profile(self, steps: range) -> None:
        before, self._is_profile = self._is_profile, True
        try:
            with suppress(Ended):
                self._flow.run(self._code, steps.start, steps)
        finally:
            self._is_profile = before

    # -- jumps and calls -----------------------------------------------------------------------

    def _find_step(self, label: str) -> int:
        if label not in self._code.labels:
            raise LineError(f"a jump to {label.upper()}, which no line has")
        return self._code.labels[label]

    def _find_next(self, at: int) -> int:
        """The first step of the line after that of a step."""
        steps = self._code.steps
        return next(k for k in range(at, len(steps) + 1) if steps[k].line > steps[at].line)

    def _jump(self, at: int) -> Step:
        """Go to a step. The main program is the first file."""
        end = self._code.labels.get("end of main", at)
        if self.machine.depth or at <= end:
            return Jump(self.machine.line, at)
        return End(self.machine.line)

    def _leap(self, leap: Leap) -> Step | None:
        """The step after M97, M98, M99, G65 or a profile. Raises LineError."""
        code, number, times, arguments = leap
        if code == "M99":
            return self._end_subprogram(number)
        if code == "GOTO":
            return self._jump(self._find_next(self._find_step(f"n{number:.0f}")))
        label = f"{'n' if code == 'M97' else 'o'}{number:.0f}"
        return self._enter_label(label, f"{code} P{number:g}", "subprogram", times, arguments)

    def _end_subprogram(self, number: float) -> Step:
        """M99.

        number: number of the line that runs next, 0 for the line after the call.
        """
        if not self.machine.depth:
            raise LineError("M99 outside a subprogram that was called")
        self._back = f"n{number:.0f}" if number else ""
        return Return(self.machine.line)

    def _enter_label(
        self, label: str, call: str, noun: str, times: int, arguments: Mapping[int, float] | None
    ) -> Step | None:
        """Runs the subroutine of a label. The call of a missing one is left out.

        Raises LineError for one more call that is too deep. The run goes on after it.
        """
        start = self._code.labels.get(label)
        if start is None:
            what = f"{call}: the {noun} is not in this file"
            self.machine.assume(f"{what}; it is left out")
            self.log.lose(what)
            return None
        try:
            self._flow.check_depth(f"{call}: more than {_DEPTH} subroutines in each other")
        except Stopped as stopped:
            raise LineError(str(stopped)) from stopped
        return self._enter(start, times, arguments)

    def _enter(self, start: int, times: int, arguments: Mapping[int, float] | None) -> Step | None:
        """Runs a subroutine some times. Returns the step after the call, None for the next one.

        arguments: its parameters, None if it has those of the caller.
        """
        known = self._known
        before = known.arguments, known.named
        if arguments is not None:
            known.arguments, known.named = dict(arguments), {}
        self.machine.depth += 1
        self._called.add(start)
        try:
            for _ in range(times):
                self._flow.run(self._code, start)
        finally:
            self.machine.depth -= 1
            known.arguments, known.named = before
        label, self._back = self._back, ""
        return self._jump(self._find_step(label)) if label else None

    def call(self, o_word: OWord) -> Step | None:
        """Calls the subroutine of an O-word. Raises LineError."""
        values, label = self._read_values(o_word, _MOST_ARGUMENTS), o_word.label
        if label.startswith("["):  # o[#1+100] call
            label = f"{value_at(label, 0, self._known)[0]:.0f}"
        arguments = dict(enumerate(values, 1))
        return self._enter_label(f"sub {label}", f"o{label} call", "subroutine", 1, arguments)

    def come_back(self, o_word: OWord) -> Step:
        """Leaves a subroutine with a value. Raises LineError."""
        values = self._read_values(o_word, 2)
        if not self.machine.depth:
            raise LineError(f"o{o_word.label} {o_word.word} outside a subroutine that was called")
        self._known.shared["_value"] = next(iter(values), 0.0)
        self._known.shared["_value_returned"] = float(bool(values))
        return Return(self.machine.line)

    def _read_values(self, o_word: OWord, count: int) -> list[float]:
        """The expressions in brackets after an O-word. Raises LineError."""
        at, text = 0, o_word.rest
        values: list[float] = []
        while text[at : at + 1] == "[" and len(values) < count:
            value, at = value_at(text, at, self._known)
            values.append(value)
        name = f"o{o_word.label} {o_word.word}"
        if at < len(text):
            raise LineError(f"cannot read {text[at : at + 12]!r} after {name}")
        if count == 1 and not values:
            raise LineError(f"{name} without its condition or number")
        return values

    def refuse(self, what: str) -> None:
        """Refuses a line. Raises LineError."""
        raise LineError(what)

    def end_main(self, _operand: object) -> Step | None:
        """The end of the first of several files ends the program, but not a subroutine."""
        return None if self.machine.depth else End(self.machine.line)

    # -- macros --------------------------------------------------------------------------------

    def _test_macro(self, macro: Macro) -> bool:
        """Whether the condition of a macro holds. Raises LineError.

        That of END holds, and that of a loop without WHILE.
        """
        text, macro.rest = self.machine.profile.clean(self.machine, macro.raw), ""
        if not text:
            # A deleted line does nothing. The lines after a WHILE run.
            return macro.word in ("while", "do")
        if macro.word == "if":
            holds, macro.rest = test_branch(text, self._known)
        elif macro.word == "end":
            holds = macro.number in self._entered
            if not holds:
                raise LineError(f"{text[:8].upper()} has no WHILE or DO before it")
        else:
            holds = test_loop(text, self._known)
            if holds:
                self._entered.add(macro.number)
        return holds

    def test_alone(self, macro: Macro) -> None:
        """A loop without END, or END without a loop. Raises LineError if it should lead to one."""
        if not self._test_macro(macro) and macro.word != "end":
            raise LineError(f"WHILE DO{macro.number} has no END{macro.number}")

    def go(self, macro: Macro) -> Step | None:
        """GOTO. Raises LineError."""
        text = self.machine.profile.clean(self.machine, macro.raw)
        return self._jump(self._find_step(read_goto(text, self._known))) if text else None

    def go_on(self, macro: Macro) -> Step | None:
        """GOTO or THEN after a condition. Raises LineError."""
        if macro.rest.startswith("then"):
            set_then(macro.rest[4:], self._known)
            return None
        return self._jump(self._find_step(read_goto(macro.rest, self._known)))

    # -- answers to the engine (`camgen.lang.flow.Language`) -----------------------------------
    # No case: G-code has none. No choice: each value is known, or assumed where it is read. No
    # state: nothing outside of a program changes its parameters, so that a loop which stands still
    # never ends, and the run stops at its limit.

    def evaluate(self, expression: OWord | Macro | RoundCount) -> float:
        """The value of a condition, or of the variable of a repeat."""
        if isinstance(expression, RoundCount):
            return expression.value
        if isinstance(expression, OWord):
            return self._read_values(expression, 1)[0]
        return self._test_macro(expression)

    def open_count(self, count: OWord) -> Counter:
        """The rounds of a repeat. As in LinuxCNC, a half is rounded to the even number."""
        return Counter(RoundCount(), 1.0, float(round(self._read_values(count, 1)[0])))

    def assign(self, target: RoundCount, value: float) -> None:
        """Set the variable of a repeat."""
        target.value = value

    def report(self, _step: Step, error: Exception) -> None:
        """Refuse a word of the flow. The run goes on after it, unless the machine stops."""
        assert isinstance(error, LineError)
        self._refuse(error)


@lru_cache(maxsize=1000)
def _in_order(*groups: str) -> tuple[str, ...]:
    """The groups of a line in the order in which their codes act, without motions."""
    return tuple(group for group in ORDER if group in groups)


def _execute(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Runs codes and words of one line, in the order of the manual. Raises LineError."""
    handlers = m.profile.handlers
    begin(m, codes, words)
    if "F" in words or "feed mode" in codes:
        feed(m, words, codes)
    if "S" in words or "T" in words:
        speed_and_tool(m, words, codes)
    motion = codes.pop("motion", "")
    if motion:
        # The motion counts, and a cycle goes on.
        codes.pop("cycle off", None)
    for group in _in_order(*codes):
        if group in codes:
            handlers[group](m, codes[group], words)
    if "machine coordinates" in codes:
        handlers["machine coordinates"](m, motion, words)
    if words or motion:
        move(m, motion, words)
    if "stop" in codes:
        m.stop(codes["stop"])
    end(m, words)
    words.pop("F", None)
    if words:
        letter, value = next(iter(words.items()))
        raise LineError(f"word {letter}{value:g}: nothing in the line uses it")
