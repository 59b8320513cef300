"""External values of a V+ program: inputs, timers, taught locations, variables of other programs.

Each value that is not in the program text becomes an assumption that the user may set. Values that
are computed from it are marked as doubtful, so that a loop that waits for them ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.lang.run import Budget
from camgen.model.program import Joints

from .arm import Arm
from .functions import truth
from .locations import make_external
from .names import canonical
from .text import Impossible, Location
from .variables import Value

#: Assumed value of an external real, such as a number of parts: loops then run once.
_REAL = 1.0
#: mm/s: assumed speed of the TCP at SPEED 100.
RATED = 7500.0
#: Kinds of variables, by the type of their values.
_KINDS: dict[type, str] = {
    float: "real",
    str: "string",
    Location: "location",
    Joints: "precision point",
}
#: Largest number of a signal.
MAX_SIGNAL = 9999


class ExternalState(Arm):
    """The variables of a program, and its external values.

    line: line of the instruction that is run.
    budget: steps that may still be taken.
    doubt: a value that was used since `doubt` was last cleared rests on an assumption.
    clock: sum of the waits, s.
    switches, parameters: values that the program has set, by name in lower case.
    outputs: signals that the program has set.
    inputs: assumed states of the other signals.
    consulted: signals that were read since the last `assume_inputs` and that the user has not set.
    timers: value of `clock` at which each timer was zero.
    """

    strict: ClassVar[bool] = False

    def __init__(self, request: RunRequest, log: Log) -> None:
        super().__init__(frozenset(), RATED)
        self.log, self.budget = log, Budget(0, request.limits.vplus_steps, "vplus_steps")
        log.line = lambda: self.line
        self.line = 0
        self.doubt = False
        self.clock = 0.0
        self.switches: dict[str, float] = {}
        self.parameters: dict[str, float] = {}
        self.outputs: dict[int, bool] = {}
        self.inputs: dict[int, bool] = {}
        self.consulted: dict[int, None] = {}
        self.timers: dict[float, float] = {}
        self._assume: Mapping[str, float] = {
            key.lower(): float(value) for key, value in request.assume.items()
        }
        self._doubtful: set[tuple[int, str]] = set()

    # -- variables ----------------------------------------------------------------------------

    def real(self, name: str) -> float:
        """Return the value of a real. Sets `doubt` if it rests on an assumption."""
        if self._doubtful:
            table, key = self.cell(name)
            self.doubt = self.doubt or (id(table), key) in self._doubtful
        return super().real(name)

    def assign(self, name: str, value: Value) -> None:
        """Assign a value of the kind that the variable has. It is doubtful if `doubt` is set."""
        table, key = self.cell(name)
        old = table.get(key)
        if old is not None and _KINDS[type(old)] != _KINDS[type(value)] and name[:1] != "#":
            raise Impossible(
                f"{name} is used as a {_KINDS[type(old)]} and as a {_KINDS[type(value)]}"
            )
        table[key] = value
        if self.doubt:
            self._doubtful.add((id(table), key))
        elif self._doubtful:
            self._doubtful.discard((id(table), key))

    def missing(self, name: str, value: Value | None, kind: str) -> Any:
        """Assume the value of a variable that the text does not set."""
        if kind == "precision point" and isinstance(value, Location):
            return value
        if value is not None:
            raise Impossible(f"{name} is used as a {_KINDS[type(value)]} and as a {kind}")
        if kind == "real":
            return self._assume_real(name)
        key = canonical(name)
        if kind != "string":
            return self._taught(key, kind)
        self.doubt = True
        base = key.partition("[")[0]
        self.log.assume(f"string {base} is set outside of this text: read as empty")
        return ""

    def _assume_real(self, name: str) -> float:
        table, key = self.cell(name)
        base = key.partition("[")[0]
        is_local = table is not self._globals
        given = self._assume.get(key, self._assume.get(base))
        taken = _REAL if given is None else given
        what = f"{base} is set outside of this text"
        if is_local:
            what = f"{base} has no value here"
            self.log.find("unusual", f"{base} is used before it has a value")
        self.log.assume(f"{what}: taken for {taken:g}", base, taken)
        table[key] = taken
        if given is None:
            self.doubt = True
            self._doubtful.add((id(table), key))
        return taken

    def _taught(self, key: str, kind: str) -> Location:
        where = "only on the controller: motions to it are given in a frame of that name"
        self.log.assume(f"{kind} {key} is {where}")
        return make_external(key)

    def is_assumed_defined(self, name: str) -> bool:
        """See `Variables.is_assumed_defined`.

        A global without a value is assumed to be defined: another program may have set it.
        """
        table, key = self.cell(name)
        if table.get(key) is not None or table is not self._globals:
            return table.get(key) is not None
        self.doubt = True
        word = f"defined({key})"
        taken = self._assume.get(word, -1.0)
        self.log.assume(
            f"{key} is assumed to be {'defined' if taken else 'not defined'}", word, taken
        )
        return taken != 0

    def answer(self, word: str, arguments: str, value: float) -> float:
        """Return the value of an external function, an assumption unless the program has set it."""
        if word == "TIMER":
            # The time of motions is unknown.
            self.doubt = True
            return self.clock - self.timers.get(float(arguments.partition(",")[0] or 0.0), 0.0)
        if word == "BITS":
            first, _, count = arguments.partition(",")
            return self.bits(int(float(first)), min(32, int(float(count.partition(",")[0] or 1.0))))
        name = "".join(arguments.split()).lower()
        stored = {"SWITCH": self.switches, "PARAMETER": self.parameters}.get(word, {})
        if name in stored:
            return stored[name]
        self.doubt = True
        key = word.lower()
        if word in ("SWITCH", "PARAMETER", "STATE"):
            key = f"{word}({name})".lower()
        taken = self._assume.get(key, value)
        self.log.assume(f"{word} is assumed to be {taken:g}", key, taken)
        return taken

    def answer_text(self, word: str) -> str:
        """Assume that the value of an external string function is empty."""
        self.doubt = True
        self.log.assume(f"{word} is assumed to be empty")
        return ""

    # -- signals ------------------------------------------------------------------------------

    def signals(self, numbers: list[float]) -> float:
        """See `Variables.signals`."""
        matches = True
        for number in numbers:
            if not abs(number) <= MAX_SIGNAL or number != int(number):
                raise Impossible(f"{number:g} is not a signal")
            matches = (self.is_on(int(abs(number))) == (number >= 0)) and matches
        return truth(matches)

    def is_on(self, number: int) -> bool:
        """Whether a signal is on. Adds an assumption for an input, or an entry of `consulted`."""
        if number in self.outputs:
            return self.outputs[number]
        given = self._assume.get(f"sig{number}", self._assume.get(str(number)))
        if given is not None:
            self.log.assume(f"signal {number} is {_state(given != 0)}", f"sig{number}", given)
            return given != 0
        self.doubt = True
        self.consulted.setdefault(number)
        return self.inputs.get(number, False)

    def assume_inputs(self) -> None:
        """Add an assumption for each input that was read, and clear `consulted`."""
        for number in self.consulted:
            on = self.inputs.setdefault(number, False)
            self.log.assume(f"signal {number} is {_state(on)}", f"sig{number}", float(on))
        self.consulted.clear()

    def bits(self, first: int, count: int) -> float:
        """Evaluate `BITS(first, count)`: signals as a binary number."""
        return float(sum(1 << k for k in range(count) if self.is_on(first + k)))


def _state(on: bool) -> str:
    return "on" if on else "off"
