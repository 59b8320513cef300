"""What a V+ program asks of its surroundings: inputs, timers, taught locations, variables of other programs.

Nothing is guessed silently: what no text holds is an assumption that the user may set, and what is worked out from it
is remembered as doubtful, so that a loop that waits for it ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.model.program import Joints

from .arm import Arm
from .functions import truth
from .locations import unknown
from .names import canonical
from .text import Impossible, Location
from .variables import Value

#: Messages are one line of at most so many characters.
_LONGEST = 160
#: What a real is taken for that only the controller has, such as a number of parts: loops then run once.
_REAL = 1.0
#: What SPEED 100 is taken to be, mm/s of the TCP.
RATED = 7500.0
#: The last signal that the controller knows.
MOST_SIGNAL = 9999
#: So many of each are told.
_MOST = 5000


class Surroundings(Arm):
    """The variables of a program, and what it hears from outside. line: of the instruction that is carried out. doubt:
    whether what was read since it was last put down rests on an assumption.
    """

    strict: ClassVar[bool] = False

    def __init__(self, ask: Ask, log: Log) -> None:
        super().__init__(frozenset(), RATED)
        self.log = log
        log.line = lambda: self.line
        self.line = 0
        self.doubt = False
        self.clock = 0.0
        self.switches: dict[str, float] = {}
        self.parameters: dict[str, float] = {}
        #: Signals that the program has set, and inputs as they are taken to be.
        self.outputs: dict[int, bool] = {}
        self.inputs: dict[int, bool] = {}
        #: Inputs that were asked for and that the user has not set.
        self.consulted: dict[int, None] = {}
        self.timers: dict[float, float] = {}
        self._assume: Mapping[str, float] = {
            key.lower(): float(value) for key, value in ask.assume.items()
        }
        self._doubtful: set[tuple[int, str]] = set()

    # -- variables -----------------------------------------------------------------------------------------------

    def real(self, name: str) -> float:
        """The value of a real; doubtful where it comes from an assumption."""
        if self._doubtful:
            table, key = self.cell(name)
            self.doubt = self.doubt or (id(table), key) in self._doubtful
        return super().real(name)

    def assign(self, name: str, value: Value) -> None:
        """Gives a variable a value; it keeps its kind, and is as doubtful as what it is made of."""
        table, key = self.cell(name)
        old = table.get(key)
        if old is not None and _kind(old) != _kind(value) and name[:1] != "#":
            raise Impossible(f"{name} is used as a {_kind(old)} and as a {_kind(value)}")
        table[key] = value
        place = (id(table), key)
        if self.doubt:
            self._doubtful.add(place)
        elif self._doubtful:
            self._doubtful.discard(place)

    def no_real(self, name: str, value: Value | None) -> float:
        """A real that this text does not set."""
        if value is not None:
            raise Impossible(f"{name} is used as a {_kind(value)} and as a real")
        table, key = self.cell(name)
        base = key.partition("[")[0]
        own = table is not self._globals
        given = self._assume.get(key, self._assume.get(base))
        taken = _REAL if given is None else given
        what = f"{base} has no value here" if own else f"{base} is set outside of this text"
        if own:
            self.log.find("unusual", f"{base} is used before it has a value")
        self.log.assume(f"{what}: taken for {taken:g}", base, taken)
        table[key] = taken
        if given is None:
            self.doubt = True
            self._doubtful.add((id(table), key))
        return taken

    def no_text(self, name: str, value: Value | None) -> str:
        """A string that this text does not set."""
        if value is not None:
            raise Impossible(f"{name} is used as a {_kind(value)} and as a string")
        self.doubt = True
        self.log.assume(
            f"string {canonical(name).partition('[')[0]} is set outside of this text: taken as empty"
        )
        return ""

    def no_location(self, name: str, value: Value | None) -> Location:
        """A location that only the controller has: it stays a name."""
        if value is not None:
            raise Impossible(f"{name} is used as a {_kind(value)} and as a location")
        return self._taught(canonical(name), "location")

    def no_point(self, name: str, value: Value | None) -> Joints | Location:
        """A precision point that only the controller has."""
        if isinstance(value, Location):
            return value
        if value is not None:
            raise Impossible(f"{name} is used as a {_kind(value)} and as a precision point")
        return self._taught(canonical(name), "precision point")

    def _taught(self, key: str, kind: str) -> Location:
        what = f"{kind} {key} is only on the controller: motions to it are given in a frame of that name"
        self.log.assume(what)
        return unknown(key)

    def says_defined(self, name: str) -> bool:
        """DEFINED: a variable of the controller has been given a value, else its program would not ask."""
        table, key = self.cell(name)
        if table.get(key) is not None or table is not self._globals:
            return table.get(key) is not None
        self.doubt = True
        word = f"defined({key})"
        taken = self._assume.get(word, -1.0)
        self.log.assume(f"{key} is taken as {'defined' if taken else 'not defined'}", word, taken)
        return taken != 0

    def answer(self, word: str, arguments: str, value: float) -> float:
        """What a function of the surroundings says."""
        if word == "TIMER":
            return self._elapsed(float(arguments.partition(",")[0] or 0.0))
        if word == "BITS":
            first, _, count = arguments.partition(",")
            return self.bits(int(float(first)), min(32, int(float(count.partition(",")[0] or 1.0))))
        stored = (
            self.switches if word == "SWITCH" else self.parameters if word == "PARAMETER" else {}
        )
        name = "".join(arguments.split()).lower()
        if name in stored:
            return stored[name]
        self.doubt = True
        key = (
            word.lower()
            if word not in ("SWITCH", "PARAMETER", "STATE")
            else f"{word}({name})".lower()
        )
        taken = self._assume.get(key, value)
        self.log.assume(f"{word} is taken for {taken:g}", key, taken)
        return taken

    def answer_text(self, word: str) -> str:
        """A string of the surroundings."""
        self.doubt = True
        self.log.assume(f"{word} is taken as empty")
        return ""

    def _elapsed(self, number: float) -> float:
        """A timer: the waits since it was set; how long motions take, no text says."""
        self.doubt = True
        return self.clock - self.timers.get(number, 0.0)

    # -- signals -------------------------------------------------------------------------------------------------

    def signals(self, numbers: list[float]) -> float:
        """``SIG(..)``: all of them as their signs say."""
        found = True
        for number in numbers:
            if not abs(number) <= MOST_SIGNAL or number != int(number):
                raise Impossible(f"{number:g} is no signal")
            found = (self.is_on(int(abs(number))) == (number >= 0)) and found
        return truth(found)

    def is_on(self, number: int) -> bool:
        """Whether a signal is on."""
        if number in self.outputs:
            return self.outputs[number]
        given = self._assume.get(f"sig{number}", self._assume.get(str(number)))
        if given is not None:
            self.log.assume(f"signal {number} is {_state(given != 0)}", f"sig{number}", given)
            return given != 0
        self.doubt = True
        self.consulted.setdefault(number)
        return self.inputs.get(number, False)

    def tell_inputs(self) -> None:
        """Tells which inputs the instruction has heard."""
        for number in self.consulted:
            on = self.inputs.setdefault(number, False)
            self.log.assume(f"signal {number} is {_state(on)}", f"sig{number}", float(on))
        self.consulted.clear()

    def bits(self, first: int, count: int) -> float:
        """``BITS(first, count)``: signals as a number."""
        return float(sum(1 << k for k in range(count) if self.is_on(first + k)))


def _kind(value: Value) -> str:
    if isinstance(value, float):
        return "real"
    return (
        "string"
        if isinstance(value, str)
        else "location"
        if isinstance(value, Location)
        else "precision point"
    )


def _state(on: bool) -> str:
    return "on" if on else "off"
