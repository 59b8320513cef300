"""Reads ABB RAPID modules back: what the text makes the robot do, and what cannot be right in it.

A subset is read: straight-line programs of declarations, PROCs without parameters, motions, outputs, waits and
pressing. Everything else is a fault that names it. Written from the RAPID manuals, not from the post.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from camgen.lang.log import Log
from camgen.lang.programs import Executed, Frames
from camgen.lang.rapid.tree import Statement
from camgen.lang.rapid.types import PREDEFINED, RESIDENT, Value
from camgen.lang.rapid.words import INSTALLED
from camgen.model.program import Force, Output

from .asked import read_asked
from .data import Scope
from .rows import Run, Spellings
from .runs import perform
from .state import Known, State
from .statements import (
    DEACTIVATIONS,
    MOTIONS,
    STATEMENTS,
    SWITCHES,
    check_deactivation,
    check_settings,
    inline,
    motion,
    switch,
)
from .syntax import (
    DEACT_WHERE_ON,
    Call,
    Data,
    Inline,
    Module,
    Routine,
    Written,
    Wrong,
    calls_of,
    parse,
)

#: Names that the text may not give again.
_SYSTEM = (INSTALLED | PREDEFINED.keys() | MOTIONS.keys() | STATEMENTS.keys()) - RESIDENT

# RAPID modules put together: who sees which name, and what is declared twice or cannot be.


@dataclass
class Linked:
    """The modules of a program, put together: who sees which name."""

    longest_name: int
    log: Log = field(default_factory=Log)
    data: dict[str, Data] = field(default_factory=dict)  # what is global, by name in lower case
    routines: dict[str, Routine] = field(default_factory=dict)
    modules: list[Module] = field(default_factory=list)
    names: set[str] = field(default_factory=set)  # of the modules, in lower case
    scopes: dict[Routine, Scope] = field(default_factory=dict)
    home: dict[Routine, dict[str, Routine]] = field(
        default_factory=dict
    )  # the local routines a routine sees
    worth: dict[Data, Value] = field(default_factory=dict)
    failed: dict[Data, Wrong] = field(default_factory=dict)
    ran: dict[Routine, None] = field(
        default_factory=dict
    )  # in the order in which they were first run
    handling: set[Routine] = field(default_factory=set)  # called by ERROR handlers

    def add(self, module: Module) -> None:
        """Enters a module; its names must be legal, and new where they are seen."""
        key = module.name.lower()
        if key in self.names:
            self.fault(module.line, f"a second module {module.name}")
        elif key in self.data or key in self.routines:
            self.fault(module.line, f"the module {module.name} has the name of something global")
        self.modules.append(module)
        self.names.add(key)
        self.legal(module.name, module.line)
        self.new(module.name, module.line)
        members: tuple[Data | Routine, ...] = (*module.data, *module.routines)
        if not self._are_new(members):
            self._enter_each(members)
        self.data |= {d.name.lower(): d for d in module.data if not d.local}
        self.routines |= {r.name.lower(): r for r in module.routines if not r.local}

    def _are_new(self, members: Sequence[Data | Routine]) -> bool:
        """Whether all members of a module have names that nothing is wrong with, looked at together."""
        keys = {item.name.lower() for item in members}
        taken = (_SYSTEM, RESIDENT, self.names, self.data.keys(), self.routines.keys())
        short = max((len(item.name) for item in members), default=0) <= self.longest_name
        return (
            len(keys) == len(members) and short and all(keys.isdisjoint(names) for names in taken)
        )

    def _enter_each(self, members: Sequence[Data | Routine]) -> None:
        """Notes what is wrong with the names of members of a module."""
        names: set[str] = set()
        for item in members:
            key = item.name.lower()
            self.legal(item.name, item.line)
            if not item.local:
                self.new(item.name, item.line)
            if key in names or (not item.local and (key in self.data or key in self.routines)):
                self.fault(item.line, f"{item.name} is declared twice")
            if not item.local and key in self.names:
                self.fault(item.line, f"{item.name} is global and has the name of a module")
            names.add(key)

    def legal(self, name: str, line: int) -> None:
        """Notes a name that is too long or taken by the system."""
        if len(name) > self.longest_name:
            self.fault(line, f"{name[:40]} is longer than {self.longest_name} characters")
        if name.lower() in _SYSTEM:
            self.fault(line, f"{name} is predefined")

    def new(self, name: str, line: int) -> None:
        """Notes a global name that a module of the controller has."""
        if name.lower() in RESIDENT:
            self.fault(line, f"{name} is the name of a system module or of what one declares")

    def fault(self, line: int, what: str) -> None:
        """Notes a fault."""
        self.log.find("refused", what, line=line)

    def check(self) -> None:
        """Values every declaration, so that one that is wrong is reported even when nothing uses it."""
        for module in self.modules:
            local = {d.name.lower(): d for d in module.data if d.local}
            routines = {r.name.lower(): r for r in module.routines if r.local}
            shared = self.scope(local, self.data)
            self.value_all(shared, module.data)
            # Routines without data of their own see the same, so that what one motion says is bound once for all.
            self.scopes |= dict.fromkeys(module.routines, shared)
            self.home |= dict.fromkeys(module.routines, routines)
            for routine in module.routines:
                if routine.data:
                    for data in routine.data:
                        self.legal(data.name, data.line)
                    own = {d.name.lower(): d for d in routine.data}
                    self.scopes[routine] = self.scope(own, local, self.data)
                    self.value_all(self.scopes[routine], routine.data)

    def scope(self, *levels: Mapping[str, Data]) -> Scope:
        """A scope that shares what is known of declarations."""
        return Scope(levels, self.worth, self.failed)

    def value_all(self, scope: Scope, data: tuple[Data, ...]) -> None:
        """Notes what is wrong with the values of declarations."""
        for item in data:
            try:
                if item.value is not None:
                    scope.worth_of(item)
            except Wrong as wrong:
                self.log.find("refused", wrong.what, line=wrong.line)

    def list_unused(self, needed: Iterable[str]) -> Iterator[Data | Routine]:
        """Routines and data of modules that neither main nor an ERROR handler uses.

        needed: names of data that may be unused
        """
        names = {name.lower() for name in needed}
        for scope in self.scopes.values():
            names |= {name.lower() for name, _ in scope.seen}
        for module in self.modules:
            yield from (item for item in module.data if item.name.lower() not in names)
            for routine in module.routines:
                if routine not in self.ran and routine not in self.handling:
                    yield routine

    def find(self, caller: Routine, name: str) -> Routine | None:
        """The PROC that ``name`` means in ``caller``."""
        return self.home[caller].get(name) or self.routines.get(name)


#: The signals of a cell whose options name none.
_SIGNALS: Mapping[str, object] = {"process": "doProcess"}
#: Longest name on IRC5 and later, and on S4.
_NAME, _NAME_S4 = 32, 16
#: More statements than any controller holds: a text whose routines call each other without end.
_MOST_STATEMENTS = 2_000_000
_DEEPEST_CALL = 40


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """What the modules say when ``main`` is run once. Never raises for a text.

    files: modules by file name; lines are counted through all of them in order. options: those of ``[post]`` that
    the text cannot say: signals, declare, force_load, force_sign, s4; and those of ``Asked``, which it should obey.
    """
    return read_with(files, options, plain=True)


def read_with(files: Mapping[str, str], options: Mapping[str, object], *, plain: bool) -> Executed:
    """As ``read``; without ``plain`` every statement is read by the general rules alone, which says the same."""
    known = _is_known(options)
    program = Linked(known.longest_name)
    line = 1
    spellings = Spellings(Written)
    for text in files.values():
        lines = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
        modules, ends = parse(lines, line, spellings if plain else None, program.log)
        for module in modules:
            program.add(module)
        line += ends + (not lines.endswith("\n"))
    program.check()
    state = _run(program, known, line - 1)
    frame = {kind: pose for kind, (_, pose) in state.frames.items()}
    frames = Frames(base_from_work=frame.get("work"), flange_from_tool=frame.get("tool"))
    return Executed(state.body.body(), state.lines, (frames,), findings=program.log.list_findings())


def _run(program: Linked, known: Known, last_line: int) -> State:
    """Runs ``main``, and notes what is still on or moving at its end."""
    state = State(known, program.scope(), program.log)
    main = program.routines.get("main")
    if main is None:
        state.log.find("refused", "there is no PROC main", line=max(last_line, 1))
        return state
    _run_routine(program, state, main, 0)
    perform(state)
    state.stopped("the end")
    check_settings(state, main.line)
    _check_handlers(program, state, main)
    for item in program.list_unused(known.asked.names.values()):
        state.remark(item.line, f"{item.name[:40]} is declared and never used")
    if state.pressing is not None:
        state.log.find("refused", "FCPressEnd is missing at the end", line=last_line)
    return state


def _run_routine(program: Linked, state: State, routine: Routine, depth: int) -> None:
    """Runs a routine with what it calls, statement by statement."""
    scope = program.scopes[routine]
    program.ran[routine] = None
    for part in cast(Sequence[Call | Inline | Run], routine.body):
        item, left = part, _MOST_STATEMENTS - state.count
        if isinstance(item, Run):
            last = min(item.last, item.first + left)
            state.count += last - item.first
            if last == item.last:
                state.wait(item, scope)
                continue
            state.wait(Run(item.rows, item.first, last), scope)
            item, left = item.rows.statement(last), 0
        state.count += 1
        if left <= 0:
            state.log.find(
                "refused", f"more than {_MOST_STATEMENTS} statements are run", line=item.line
            )
            return
        state.scope = scope
        try:
            if isinstance(item, Inline) and item.shape.name in MOTIONS:
                perform(state)
                inline(state, item)
            else:
                _run_call(
                    program,
                    state,
                    routine,
                    item.call() if isinstance(item, Inline) else item,
                    depth,
                )
        except Wrong as wrong:
            state.log.find("refused", wrong.what, line=wrong.line)


def _run_call(program: Linked, state: State, routine: Routine, call: Call, depth: int) -> None:
    if call.name in MOTIONS:
        perform(state)
        motion(state, call)
    elif call.name in STATEMENTS:
        perform(state)
        STATEMENTS[call.name](state, call)
    else:
        _run_routine(program, state, _find_called(program, routine, call, depth), depth + 1)


def _find_called(program: Linked, routine: Routine, call: Call, depth: int) -> Routine:
    """The PROC that a statement calls."""
    found = program.find(routine, call.name)
    if found is None:
        raise Wrong(call.line, f"the statement {call.name[:40]} is not read")
    if call.args or call.options:
        raise Wrong(call.line, f"{call.name[:40]} is called with arguments")
    if depth >= _DEEPEST_CALL:
        raise Wrong(call.line, f"{call.name[:40]} is called too deeply")
    return found


# ERROR handlers: what they leave on. An error in a routine without one, or with RAISE in it, comes to that of main.


def _check_handlers(program: Linked, state: State, main: Routine) -> None:
    """Notes what is wrong with the handlers of the program, and the outputs that it uses and that one leaves on."""
    used = dict.fromkeys(item.signal for item in state.body.objects if isinstance(item, Output))
    _find_missing_handlers(program, state, main, used)
    for routine in program.scopes:
        if routine.handler is None or (routine is not main and _hands_on(routine.handler)):
            continue
        _check_form(state, routine, main)
        try:
            off, end = _handle(program, state, routine, routine.handler, 0)
            line = routine.handler[-1].line if routine.handler else routine.line
            if not end:
                raise Wrong(
                    line,
                    f"the ERROR handler of {routine.name} goes on behind the error; end it with RAISE",
                )
            left = sorted(used.keys() - off.keys()) if end == "exit" or routine is main else []
            if left:
                raise Wrong(
                    line, f"the ERROR handler of {routine.name} leaves {', '.join(left)[:60]} on"
                )
            if routine is main:
                _judge_main_handler(state, line, [*used, DEACT_WHERE_ON], off, end)
        except Wrong as wrong:
            state.log.find("refused", wrong.what, line=wrong.line)


def _check_form(state: State, routine: Routine, main: Routine) -> None:
    """Remarks on a handler that does more than those of posts.

    In main it calls routines, ends force control and ends. In another routine it is RAISE alone.
    """
    for item in calls_of(routine.handler or ()):
        if routine is not main:
            what = f"the ERROR handler of {routine.name} does more than RAISE"
        elif item.shape.name in SWITCHES if isinstance(item, Inline) else item.name in SWITCHES:
            what = "the ERROR handler of main switches an output itself, not in a routine"
        else:
            continue
        state.remark(item.line, what)
        return


def _hands_on(handler: Sequence[Statement]) -> bool:
    """Whether an ERROR handler is RAISE alone, with which the error comes to that of main."""
    return len(handler) == 1 and isinstance(handler[0], Call) and handler[0].name == "raise"


def _judge_main_handler(
    state: State, line: int, order: list[str], off: dict[str, None], end: str
) -> None:
    """Notes where the handler of main leaves force control on, has another order, or ends otherwise than options ask.

    order: in which the program names its outputs; the force is last, so that nothing runs without it.
    """
    if [name for name in off if name in order] != [name for name in order if name in off]:
        state.remark(
            line,
            "the ERROR handler of main switches off in another order than posts do, force control last",
        )
    wanted = state.known.asked.on_error
    if DEACT_WHERE_ON not in off and any(isinstance(item, Force) for item in state.body.objects):
        state.remark(line, "the ERROR handler of main leaves force control on")
    if end != wanted:
        state.remark(
            line,
            f"the ERROR handler of main ends with {end.upper()}, by post.on_error it is {wanted}",
        )


def _find_missing_handlers(
    program: Linked, state: State, main: Routine, used: Mapping[str, None]
) -> None:
    """Notes routines without an ERROR handler where the options ask for one: main's, then those that hand errors on."""
    drops = used or any(isinstance(item, Force) for item in state.body.objects)
    if state.known.asked.on_error == "none" or not drops:
        return
    if main.handler is None:
        state.remark(main.line, "main has no ERROR handler, which post.on_error asks for")
        return
    for routine in program.ran:
        if routine.handler is None:
            state.remark(
                routine.line, f"{routine.name} has no ERROR handler that hands an error on to main"
            )


def _handle(
    program: Linked, state: State, routine: Routine, body: Sequence[Statement], depth: int
) -> tuple[dict[str, None], str]:
    """The outputs that ``body``, of a handler or of what it calls, switches off, and the word that it ends with.

    They are in order. The outputs have ``DEACT_WHERE_ON`` among them where it ends force control.
    """
    off: dict[str, None] = {}
    for item in calls_of(body):
        call = item.call() if isinstance(item, Inline) else item
        state.scope = program.scopes[routine]
        if call.name in ("raise", "exit"):
            if item is not body[-1]:
                raise Wrong(call.line, f"statements after {call.name.upper()}")
            return off, call.name
        if call.name in SWITCHES:
            one = switch(state, call)
            if one.value:
                raise Wrong(call.line, "an ERROR handler that switches something on")
            off[one.signal] = None
        elif call.name in DEACTIVATIONS:
            check_deactivation(state, call)
            off[DEACT_WHERE_ON] = None
        elif call.name in MOTIONS or call.name in STATEMENTS:
            raise Wrong(call.line, f"{call.name} in an ERROR handler is not read")
        else:
            called = _find_called(program, routine, call, depth)
            program.handling.add(called)
            off |= _handle(program, state, called, called.body, depth + 1)[0]
    return off, ""


def _is_known(options: Mapping[str, object]) -> Known:
    given = options.get("signals", _SIGNALS)
    signals = (
        {str(name).lower(): str(key) for key, name in given.items()}
        if isinstance(given, Mapping)
        else {}
    )
    return Known(
        signals=signals,
        external=options.get("declare", True) is False,
        sign=-1 if options.get("force_sign", 1) == -1 else 1,
        longest_name=_NAME_S4 if options.get("s4", False) is True else _NAME,
        asked=read_asked(options),
    )
