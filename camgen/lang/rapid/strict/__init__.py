"""Reads ABB RAPID modules of a post back: text -> instructions, findings by line.

A subset of the language is read: declarations, PROCs without parameters, motions, outputs, waits
and pressing, without branches. Everything else is refused by name. The module is written from the
RAPID manuals, not from the post.
"""

from __future__ import annotations

from collections.abc import Mapping

from camgen.lang.programs import Executed, Frames, unify_line_ends
from camgen.lang.rapid.rows import Spellings
from camgen.lang.rapid.tokens import Wrong
from camgen.lang.rapid.tree import Block, Calling, Inline, Routine, Run
from camgen.lang.values import require
from camgen.model.program import Force, Output

from .expected import read_settings
from .names import enter_module, list_unused, open_scopes
from .runs import perform
from .state import State
from .statements import (
    DEACTIVATIONS,
    MOTIONS,
    STATEMENTS,
    SWITCHES,
    check_deactivation,
    check_settings,
    inline,
    switch,
)
from .syntax import DEACT_WHERE_ON, Written, calls_of, parse

#: Maximum number of statements that are run. No controller holds so large a program: beyond it,
#: routines call each other without end.
_MOST_STATEMENTS = 2_000_000
_DEEPEST_CALL = 40


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Runs `main` of the modules once. It raises nothing for any text.

    files: modules by file name. Lines are counted through all of them in order.
    options: options of the post. signals, declare, force_load, force_sign and s4 give what the text
        does not state. The text must agree with the others of `PostSettings`.
    Raises JobError if an option has the wrong type.
    """
    return read_with(files, options, plain=True)


def read_with(files: Mapping[str, str], options: Mapping[str, object], *, plain: bool) -> Executed:
    """Reads modules like `read`.

    plain: whether statements in the usual spelling are read by column. The result is the same.
    """
    state = State(settings=read_settings(options))
    line = 1
    spellings = Spellings(Written, MOTIONS)
    for text in files.values():
        lines = unify_line_ends(text)
        for module in parse(lines, line, spellings if plain else None, state.log):
            enter_module(state, module)
        line += lines.count("\n") + (not lines.endswith("\n"))
    open_scopes(state)
    _run(state, line - 1)
    frame = {kind: pose for kind, (_, pose) in state.set_up.items()}
    frames = Frames(base_from_work=frame.get("work"), flange_from_tool=frame.get("tool"))
    findings = state.log.list_findings()
    return Executed(state.packing.body(), state.lines, (frames,), findings=findings)


def _run(state: State, last_line: int) -> None:
    """Runs `main`. A motion or a force that does not end with it is a finding."""
    main = state.routines.get("main")
    if main is None:
        state.log.find("refused", "there is no PROC main", line=max(last_line, 1))
        return
    _run_routine(state, main, 0)
    perform(state)
    state.stopped("the end")
    state.line = main.line
    check_settings(state)
    _check_handlers(state, main)
    for item in list_unused(state):
        state.remark(f"{item.name[:40]} is declared and never used", line=item.line)
    if state.pressing is not None:
        state.log.find("refused", "FCPressEnd is missing at the end", line=last_line)


def _run_routine(state: State, routine: Routine, depth: int) -> None:
    scope = state.scopes[routine]
    state.ran[routine] = None
    for part in routine.body:
        if isinstance(part, Run) and part.is_free and len(part) <= _MOST_STATEMENTS - state.count:
            state.count += len(part)
            state.waiting.append((part, scope))
            continue
        for item in calls_of((part,)):
            state.count += 1
            if state.count > _MOST_STATEMENTS:
                what = f"more than {_MOST_STATEMENTS} statements are run"
                state.log.find("refused", what, line=item.line)
                return
            state.scope, state.line = scope, item.line
            try:
                _run_statement(state, routine, item, depth)
            except Wrong as wrong:
                state.log.find("refused", wrong.what, line=wrong.line)


def _run_statement(state: State, routine: Routine, item: Calling | Inline, depth: int) -> None:
    if isinstance(item, Calling) and item.name not in STATEMENTS:
        _run_routine(state, _find_called(state, routine, item, depth), depth + 1)
        return
    perform(state)
    if isinstance(item, Inline):
        inline(state, item)
    else:
        STATEMENTS[item.name](state, item)


def _find_called(state: State, routine: Routine, call: Calling, depth: int) -> Routine:
    """The PROC that a statement calls. Raises Wrong if it cannot be called."""
    called = require(
        state.find_routine(state.homes[routine], call.name),
        Wrong(call.line, f"{call.name[:40]} is a statement that is not read"),
    )
    if call.args or call.options:
        raise Wrong(call.line, f"{call.name[:40]} is called with arguments")
    if depth >= _DEEPEST_CALL:
        raise Wrong(call.line, f"{call.name[:40]} is called too deeply")
    return called


# ERROR handlers, and the outputs that they leave on. The handler of main handles the errors of
# routines without a handler or with RAISE in it.


def _check_handlers(state: State, main: Routine) -> None:
    """Adds findings for faults of the ERROR handlers and for outputs that a handler leaves on."""
    used = dict.fromkeys(item.signal for item in state.packing.objects if isinstance(item, Output))
    _find_missing_handlers(state, main, used)
    for routine in state.scopes:
        if routine.handler is None or (routine is not main and _hands_on(routine.handler)):
            continue
        _check_form(state, routine, main)
        try:
            switched_off, end = _handle(state, routine, routine.handler, 0)
            line = max([routine.line, *(call.line for call in calls_of(routine.handler))])
            if not end:
                what = "continues after the error; end it with RAISE"
                raise Wrong(line, f"the ERROR handler of {routine.name} {what}")
            is_last = end == "exit" or routine is main
            signals_on = sorted(used.keys() - switched_off.keys()) if is_last else []
            if signals_on:
                names = ", ".join(signals_on)[:60]
                raise Wrong(line, f"the ERROR handler of {routine.name} leaves {names} on")
            if routine is main:
                _check_main_handler(state, line, [*used, DEACT_WHERE_ON], switched_off, end)
        except Wrong as wrong:
            state.log.find("refused", wrong.what, line=wrong.line)


def _check_form(state: State, routine: Routine, main: Routine) -> None:
    """Adds a finding for a handler that does more than those of posts.

    In main it calls routines, ends force control and ends. In another routine it is RAISE alone.
    """
    for item in calls_of(routine.handler or ()):
        name = item.shape.name if isinstance(item, Inline) else item.name
        if routine is not main:
            what = f"the ERROR handler of {routine.name} does more than RAISE"
        elif name in SWITCHES:
            what = "the ERROR handler of main switches an output itself, not in a routine"
        else:
            continue
        state.remark(what, line=item.line)
        return


def _hands_on(handler: Block) -> bool:
    """Whether an ERROR handler is RAISE alone, so that the handler of main gets the error."""
    return len(handler) == 1 and isinstance(handler[0], Calling) and handler[0].name == "raise"


def _check_main_handler(
    state: State, line: int, order: list[str], switched_off: dict[str, None], end: str
) -> None:
    """Adds findings if the handler of main differs from the handler that the options ask for.

    order: outputs in the order in which the program uses them, then the force.
    switched_off: outputs that the handler switches off, in order.
    end: last word of the handler.
    """
    if [name for name in switched_off if name in order] != [
        name for name in order if name in switched_off
    ]:
        what = "switches off in another order than posts do, force control last"
        state.remark(f"the ERROR handler of main {what}", line=line)
    has_force = any(isinstance(item, Force) for item in state.packing.objects)
    if has_force and DEACT_WHERE_ON not in switched_off:
        state.remark("the ERROR handler of main leaves force control on", line=line)
    wanted = state.settings.on_error
    if end != wanted:
        what = f"ends with {end.upper()}, by post.on_error it is {wanted}"
        state.remark(f"the ERROR handler of main {what}", line=line)


def _find_missing_handlers(state: State, main: Routine, used: Mapping[str, None]) -> None:
    """Adds findings for missing ERROR handlers: of main, or of routines that pass errors to it."""
    is_needed = used or any(isinstance(item, Force) for item in state.packing.objects)
    if state.settings.on_error == "none" or not is_needed:
        return
    if main.handler is None:
        state.remark("main has no ERROR handler, which post.on_error asks for", line=main.line)
        return
    for routine in state.ran:
        if routine.handler is None:
            what = f"{routine.name} has no ERROR handler that hands an error on to main"
            state.remark(what, line=routine.line)


def _handle(state: State, routine: Routine, body: Block, depth: int) -> tuple[dict[str, None], str]:
    """The outputs that a handler switches off, in order, and the word that it ends with.

    `DEACT_WHERE_ON` is among the outputs if the handler ends force control.
    body: statements of the handler or of a routine that it calls.
    Raises Wrong for a statement that a handler may not have.
    """
    switched_off: dict[str, None] = {}
    for item in calls_of(body):
        call = item.call() if isinstance(item, Inline) else item
        state.scope, state.line = state.scopes[routine], call.line
        if call.name in ("raise", "exit"):
            if item is not body[-1]:
                raise Wrong(call.line, f"statements after {call.name.upper()}")
            return switched_off, call.name
        if call.name in SWITCHES:
            output = switch(state, call)
            if output.value:
                raise Wrong(call.line, "an ERROR handler that switches something on")
            switched_off[output.signal] = None
        elif call.name in DEACTIVATIONS:
            check_deactivation(state, call)
            switched_off[DEACT_WHERE_ON] = None
        elif call.name in STATEMENTS:
            raise Wrong(call.line, f"{call.name} in an ERROR handler is not read")
        else:
            called = _find_called(state, routine, call, depth)
            state.handling.add(called)
            switched_off |= _handle(state, called, called.body, depth + 1)[0]
    return switched_off, ""
