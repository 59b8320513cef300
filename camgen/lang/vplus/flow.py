"""The control of V+: tests, loops, jumps and calls, followed once from the entry to the end or to a bound.

A loop that runs for ever, or that waits for what no text holds, is told for one round (``--assume rounds=3``: for
three). Of a test on an input that nobody has set, the way that leads on is taken: an input that would end the program
is as it must be for the program to go on.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial

from msgspec import Struct

from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.lang.run import Budget, Ended, LoopRounds, Stopped
from camgen.model.program import Joints, MoveC, MoveJ, MoveL
from camgen.model.text import counted

from .instructions import MOTIONS, REACTIONS
from .locations import Expression
from .names import canonical
from .statements import ENDS, split, unwrap
from .text import Impossible, Location, Routine, Statement, Stretch, Unreadable
from .units import Units
from .variables import Cell, Table, Value
from .walk import walk, walk_apart

#: So many programs may call each other: V+ has a stack, too.
_DEEPEST = 60
CALLED = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(\(.*\))?", re.DOTALL)
GOES = re.compile(r"\bGOTO\s+(\d+)\s*$", re.IGNORECASE)
_MOST_STATE = 3000
#: So many characters of a line, or values that are looked through, count as an instruction.
_LONG = 60
#: What the bound of a run gives for each line of a file that the program reads.
_READS = 100
_LEAVES = frozenset({"GOTO", "RETURN", "RETURNE", "PAUSE"}) | ENDS


class _For(Struct, gc=False):
    """A FOR that runs."""

    name: str
    last: float
    step: float


class _Running:
    """A program that runs.

    counting: its FOR loops by the index of their first statement.
    rounds: rounds of each loop, by the index of the statement that repeats it.
    """

    __slots__ = ("counting", "rounds", "routine")

    def __init__(self, routine: Routine) -> None:
        self.routine = routine
        self.counting: dict[int, _For] = {}
        self.rounds: dict[int, LoopRounds] = {}


class Machine(Units):
    """The controller, with the programs that it has. stopped: where and why the run broke off. ran,
    done: the programs and the lines that were carried out.
    """

    def __init__(self, programs: Sequence[Routine], ask: Ask, log: Log) -> None:
        super().__init__(ask, log)
        self._programs: dict[str, Routine] = {}
        for routine in programs:
            self._programs.setdefault(canonical(routine.name), routine)
        self._kept: dict[str, Table] = {}
        self._rounds = max(1, int(min(self._assume.get("rounds", 1.0), 1e6)))
        size = sum(_cost(statement) for program in programs for statement in program.statements)
        self._budget = Budget(size, ask.limits.vplus_steps, "vplus_steps")
        self.stopped: tuple[int, str] | None = None
        self.ran: set[str] = set()
        self.done: set[int] = set()

    def lay_beside(self, files: Mapping[str, str]) -> None:
        """Files that the programs may read, by name; each line of them may be read and worked with."""
        super().lay_beside(files)
        self._budget.left += _READS * sum(text.count("\n") for text in files.values())

    def find_program(self, key: str) -> Routine | None:
        """The program of a name in its canonical form."""
        return self._programs.get(key)

    def spend(self, count: int) -> None:
        """Take as many steps from the budget of the run. Stopped if it has too few."""
        self._budget.spend(count)

    def last(self, name: str) -> float:
        """The last index of an array."""
        self.spend(len(self.cell(name).table) // 8)
        return super().last(name)

    def give(self, values: Mapping[str, Value]) -> None:
        """Globals that have a value before the program starts."""
        self._globals.update(values)

    def run(self, routine: Routine) -> None:
        """Carries out ``routine`` and what it calls."""
        try:
            self._run(routine, {})
        except Ended:
            pass
        except Stopped as error:
            self.stopped = self.line, str(error)
        self.finish()

    def _run(self, routine: Routine, arguments: Mapping[str, Cell]) -> None:
        key = canonical(routine.name)
        self.ran.add(key)
        self.enter(self._kept.setdefault(key, {}))
        self._scopes[-1].others.update(arguments)
        walk(routine, partial(self._step, _Running(routine)), self._stretch, self._unreadable)
        self.leave()

    def _step(self, running: _Running, index: int, statement: Statement) -> int:
        self.line = statement.line
        self.doubt = False
        self.done.add(statement.line)
        self.spend(1 + len(statement.rest) // _LONG)
        after = self._next(running, index, statement)
        if self.consulted:
            self.tell_inputs()
        return after

    def _stretch(self, plain: Stretch) -> None:
        self.line = plain.line
        self.spend(len(plain.poses))
        if self.stretch(plain):
            self.line = plain.line + len(plain.poses) - 1
            return
        walk_apart(plain, self._do_apart, self._unreadable)

    def _do_apart(self, statement: Statement) -> None:
        self.line, self.doubt = statement.line, False
        self.do(statement)

    def _unreadable(self, statement: Statement, error: Unreadable) -> None:
        if self.doubt and isinstance(error, Impossible):
            what = f"not evaluated: {error} (with what is assumed)"
            self.log.find("unusual", what, line=statement.line)
            self.log.lose(what, line=statement.line)
        else:
            self.log.find("refused", str(error), line=statement.line)
        if statement.word in MOTIONS:
            self.lost(statement.word)
        if self.consulted:
            self.tell_inputs()

    # -- control -------------------------------------------------------------------------------------------------

    def _next(self, running: _Running, index: int, statement: Statement) -> int:
        """Carries out one instruction; the index of the one after it."""
        word, routine = statement.word, running.routine
        if word in _CONTROL:
            return _CONTROL[word](self, running, index, statement)
        if word in ("RETURN", "RETURNE"):
            return len(routine.statements)
        if word in ENDS:
            raise Ended
        if word == "CALL":
            self._call(statement.rest)
        elif word == "CALLS":
            self._call_by_text(statement.rest)
        elif word in REACTIONS:
            call = self.react(statement)
            if call:
                self._call(call)
        elif word == "WAIT":
            self.wait(statement.rest)
        elif word == "WAIT.EVENT":
            self.wait_event(statement.rest)
        else:
            self.do(statement)
        return index + 1

    def _if(self, running: _Running, index: int, statement: Statement) -> int:
        routine, rest = running.routine, statement.rest
        jump = GOES.search(rest)
        if jump and index not in routine.partner:
            holds, _, _ = self.condition(rest[: jump.start()], ("",))
            if holds and self.consulted and self._leads_out(routine, int(jump[1]), index):
                holds = not self.wish(rest[: jump.start()], False, fresh=True)
            return self._jump(running, index, int(jump[1])) if holds else index + 1
        if index not in routine.partner:
            raise Unreadable("IF wants THEN or GOTO")
        holds, _, _ = self.condition(rest, ("THEN",) if rest[-4:].upper() == "THEN" else ())
        branches, end = routine.branches.get(index, ()), routine.partner[index]
        first_end = branches[0] if branches else end
        if (
            holds
            and self.consulted
            and not branches
            and self._leaves(routine, index + 1, first_end)
        ):
            holds = not self.wish(rest, False, fresh=True)
        return index + 1 if holds else first_end + 1

    def _leaves(self, routine: Routine, start: int, end: int) -> bool:
        """Whether what stands there ends the program or jumps out."""
        found = routine.statements[start:end][-3:]
        return any(isinstance(s, Statement) and s.word in _LEAVES for s in found)

    def _leads_out(self, routine: Routine, label: int, index: int) -> bool:
        """Whether a jump ahead leads to the last lines of the program."""
        place = routine.labels.get(label, -1)
        return place > index and len(routine.statements) - place <= 8

    def _else(self, running: _Running, index: int, _: Statement) -> int:
        """The end of a branch that was carried out."""
        opener = running.routine.opener.get(index)
        return index + 1 if opener is None else running.routine.partner.get(opener, index) + 1

    def _while(self, running: _Running, index: int, statement: Statement) -> int:
        end = running.routine.partner.get(index)
        if end is None:
            raise Unreadable("WHILE is not closed")
        holds, open_, _ = self.condition(statement.rest, ("DO", ""))
        if statement.rest[-2:].upper() != "DO":
            self.log.find("refused", "WHILE wants DO", line=statement.line)
        if holds and not self._again(running, index, open_):
            self.wish(statement.rest[:-2], False, fresh=False)
            holds = False
        if not holds:
            running.rounds.pop(index, None)
            return end + 1
        return index + 1

    def _until(self, running: _Running, index: int, statement: Statement) -> int:
        start = running.routine.opener.get(index)
        if start is None:
            return index + 1
        holds, open_, _ = self.condition(statement.rest, ("",))
        if not holds and (not self.consulted or not self.wish(statement.rest, True, fresh=False)):
            # The body of a DO has run once by now.
            if index not in running.rounds:
                running.rounds[index] = LoopRounds()
                running.rounds[index].count = int(open_)
            if self._again(running, index, open_):
                return start + 1
        running.rounds.pop(index, None)
        return index + 1

    def _again(self, running: _Running, index: int, open_: bool) -> bool:
        """Whether a loop is told for one more round. open_: nothing that is known ends it."""
        loop = running.rounds.setdefault(index, LoopRounds())
        if open_:
            loop.count += 1
            if loop.count <= self._rounds:
                return True
            rounds = counted(self._rounds, "round")
            what = f"a loop that nothing known ends is run for {rounds}"
            self.log.assume(what, "rounds", self._rounds)
            return False
        if loop.is_repeated(self._state, len(self.body)):
            self._cut(loop.length)
            self.log.assume("a loop that repeats itself for ever is told for one of its rounds")
            return False
        return True

    def _state(self) -> object:
        """What the next round depends on; None where that is too much to keep."""
        tables = [self._globals]
        for scope in self._scopes:
            tables += [scope.own, scope.kept]
        size = sum(map(len, tables))
        if size > _MOST_STATE:
            return None
        self.spend(size // _LONG)
        values = tuple(tuple((k, _plain(v)) for k, v in table.items()) for table in tables)
        return values, _plain(self._at), tuple(self.outputs.items()), self._always, self._once

    def _cut(self, length: int) -> None:
        """Takes back what the repeated round has added."""
        del (
            self.body[length:],
            self.lines[length:],
            self.frames[length:],
            self.bases[length:],
            self.tool[length:],
        )
        for index in [index for index in self.durations if index >= length]:
            del self.durations[index]
        found = (
            k for k in reversed(range(length)) if isinstance(self.body[k], (MoveJ, MoveL, MoveC))
        )
        self._last = next(found, None)

    def _for(self, running: _Running, index: int, statement: Statement) -> int:
        end = running.routine.partner.get(index)
        if end is None:
            raise Unreadable("FOR is not closed")
        text = Expression(statement.rest, self)
        name = text.take()
        if not name[0].isalpha():
            raise Unreadable(f"{name[:20]!r} is no name")
        name += text.subscripts()
        text.expect("=")
        first = text.real()
        text.expect("TO")
        last = text.real()
        step = text.real() if text.accept("STEP") else 1.0
        text.finish()
        if step == 0:
            raise Impossible("a loop with step 0")
        self.assign(name, first)
        if (first - last) * step > 0:
            return end + 1
        running.counting[index] = _For(name, last, step)
        return index + 1

    def _end(self, running: _Running, index: int, _: Statement) -> int:
        start = running.routine.opener.get(index)
        if start is None:
            return index + 1
        opener = running.routine.statements[start]
        assert isinstance(opener, Statement)
        if opener.word == "WHILE":
            return start
        loop = running.counting.get(start)
        if opener.word != "FOR" or loop is None:
            return index + 1
        value = self.real(loop.name) + loop.step
        self.assign(loop.name, value)
        # A step of 0.1 does not add up exactly, nor does it on the controller: half a millionth of it is no round.
        if (value - loop.last) * loop.step > 0:
            del running.counting[start]
            return index + 1
        return start + 1

    def _case(self, running: _Running, index: int, statement: Statement) -> int:
        routine = running.routine
        if index not in routine.partner:
            raise Unreadable("CASE is not closed")
        text = Expression(statement.rest, self)
        wanted: float | str = text.string() if text.is_string() else text.logic()
        text.expect("OF")
        text.finish()
        for place in routine.branches.get(index, ()):
            branch = routine.statements[place]
            assert isinstance(branch, Statement)
            self.spend(1)
            if branch.word == "ANY" or self._is_one_of(wanted, branch):
                return place + 1
        return routine.partner[index] + 1

    def _is_one_of(self, wanted: float | str, branch: Statement) -> bool:
        if branch.rest[-1:] != ":":
            raise Unreadable("VALUE wants a colon at its end")
        for item in split(branch.rest[:-1]):
            text = Expression(item, self)
            value: float | str = text.string() if text.is_string() else text.logic()
            text.finish()
            if value == wanted:
                return True
        return False

    def _goto(self, running: _Running, index: int, statement: Statement) -> int:
        return self._jump(running, index, read_label(statement.rest))

    def _jump(self, running: _Running, index: int, label: int) -> int:
        place = running.routine.labels.get(label)
        if place is None:
            raise Unreadable(f"there is no label {label} in this program")
        if place <= index and not self._again(running, index, open_=False):
            return index + 1
        return place

    def _exit(self, running: _Running, index: int, statement: Statement) -> int:
        text = Expression(statement.rest or "1", self)
        count = text.logic()
        text.finish()
        loops = running.routine.loops.get(index, ())
        if not 1 <= count <= len(loops) or count != int(count):
            raise Unreadable(f"{statement.word} outside of a loop")
        start = loops[int(count) - 1]
        end = running.routine.partner.get(start, index)
        if statement.word == "NEXT":
            return end
        for inner in loops[: int(count)]:
            running.counting.pop(inner, None)
            for place in (inner, running.routine.partner.get(inner, inner)):
                running.rounds.pop(place, None)
        return end + 1

    def _do_loop(self, _: _Running, index: int, statement: Statement) -> int:
        if statement.rest:
            raise Unreadable("DO stands alone")
        return index + 1

    # -- calls ---------------------------------------------------------------------------------------------------

    def _call(self, rest: str) -> None:
        match = CALLED.fullmatch(rest)
        if match is None:
            raise Unreadable("CALL wants the name of a program and its arguments")
        self._enter(match[1], match[2] or "()")

    def _call_by_text(self, rest: str) -> None:
        text = Expression(rest, self)
        name = text.string()
        left = text.rest()
        if not name:
            self._leave_out(f"CALLS {rest}: which program, is not known: left out")
            return
        self._enter(name, left or "()")

    def _leave_out(self, what: str) -> None:
        self.log.assume(what)
        self.log.lose(what)

    def _enter(self, name: str, brackets: str) -> None:
        routine = self._programs.get(canonical(name))
        if routine is None:
            self._leave_out(f"program {name} is not in these files: left out")
            return
        if self.depth > _DEEPEST:
            raise Stopped(f"more than {_DEEPEST} programs call each other")
        given = list(split(unwrap(brackets)[0]))
        formals = [part.removesuffix("[]").strip() for part in split(routine.arguments)]
        if len([g for g in given if g]) > len([f for f in formals if f]):
            self.log.find("unusual", f"more arguments than program {routine.name} has")
        given += [""] * (len(formals) - len(given))
        cells = {
            canonical(formal.lstrip("&")): self.argument(formal.lstrip("&"), text)
            for formal, text in zip(formals, given, strict=False)
            if formal
        }
        line = self.line
        self.tell_inputs()
        self._run(routine, cells)
        self.line = line


def read_label(rest: str) -> int:
    """The label of a GOTO."""
    if not (rest.isdigit() and rest.isascii()) or len(rest) > 5:
        raise Unreadable(f"GOTO wants a label, not {rest[:20] or 'nothing'}")
    return int(rest)


def _cost(statement: Statement | Stretch) -> int:
    return (
        len(statement.poses) if isinstance(statement, Stretch) else 1 + len(statement.rest) // _LONG
    )


def _plain(value: object) -> object:
    """Something that can be compared."""
    if isinstance(value, Location):
        return (
            value.local.origin,
            value.local.rotation.tobytes(),
            value.frame.external,
            value.frame.pose.origin,
        )
    return value.values if isinstance(value, Joints) else value


_CONTROL = {
    "ANY": Machine._else, "CASE": Machine._case, "DO": Machine._do_loop, "ELSE": Machine._else, "END": Machine._end,
    "EXIT": Machine._exit, "FOR": Machine._for, "GOTO": Machine._goto, "IF": Machine._if, "NEXT": Machine._exit,
    "UNTIL": Machine._until, "VALUE": Machine._else, "WHILE": Machine._while,
}  # fmt: skip
