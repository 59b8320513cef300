"""The way through a PacScript program: conditions, loops, jumps, and what is taken where no text decides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec import Struct

from camgen.lang.pacscript.code import Code, Op
from camgen.lang.pacscript.evaluate import assign, assign_name, evaluate
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import calculate
from camgen.lang.pacscript.running import Running
from camgen.lang.pacscript.values import Array, Unknown, Unreadable, Value, number
from camgen.lang.run import Ended, LoopRounds, Stopped
from camgen.model.pose import Pose

_LEAVING = frozenset(("exit", "end", "return", "halt", "stop", "stopend", "raise", "givearm"))


class Frame(Struct, gc=False):
    """A procedure that runs.

    loops: end and step of each For, by its step in the code.
    rounds: rounds of each loop, by the step that repeats it.
    undecided: steps of loops that were entered without a known condition.
    leaving: steps at which an unknown condition could have left, with the steps of that branch.
    handler: label of On Error.
    """

    code: Code
    loops: dict[int, tuple[float, float]]
    rounds: dict[int, LoopRounds]
    undecided: set[int]
    leaving: dict[int, tuple[int, int]]
    returns: list[int]
    handler: str = ""


def truth(value: Value) -> bool | Unknown:
    """Whether a condition holds."""
    return value if isinstance(value, Unknown) else bool(number(value))


def branch(run: Running, frame: Frame, at: int, op: Op) -> int | None:
    """``If``: on with the next step, or with ``op.to``."""
    found = truth(evaluate(run, op.a))
    if isinstance(found, Unknown):
        found = _choose(frame, at, op)
        taken = "the branch is gone into" if found else "the branch is passed by"
        run.machine.log.choose(f"{found_name(op, run)} is not known: {taken}", _key(op.a, run))
    return None if found else op.to


def found_name(op: Op, run: Running) -> str:
    """What a condition that is not known asks."""
    value = evaluate(run, op.a) if op.a.kind != "call" else Unknown(str(op.a.said))
    return value.what if isinstance(value, Unknown) else "a condition"


def _key(node: Node, run: Running) -> str:
    value = evaluate(run, node) if node.kind != "call" else 0.0
    return value.key if isinstance(value, Unknown) else ""


def _choose(frame: Frame, at: int, op: Op) -> bool:
    """Whether to go into a branch whose condition is not known: rather not where it leaves, rather where it acts."""
    ops = frame.code.ops
    last = ops[op.to - 1] if op.to - 1 > at else None
    other = (
        (op.to, last.to)
        if last and last.do == "goto" and last.a is None and last.b is None
        else (op.to, op.to)
    )
    then = (at + 1, op.to - (other[1] > other[0]))
    leaves = [_leaves(ops, *span) for span in (then, other)]
    if leaves[0] != leaves[1]:
        frame.leaving[at] = then if leaves[0] else other
        return leaves[1]
    acting = frame.code.acting
    acts = [acting[end] - acting[start] > 0 for start, end in (then, other)]
    return acts[0] >= acts[1] and op.a.kind not in ("<>", "not")


def _leaves(ops: list[Op], start: int, end: int) -> bool:
    """Whether the last step of a span leaves it for good."""
    if end <= start:
        return False
    last = ops[end - 1]
    return last.do in _LEAVING or (last.do == "goto" and (last.a is not None or last.b is not None))


def go_to(run: Running, frame: Frame, at: int, op: Op) -> int:
    """``GoTo`` and the jumps of blocks."""
    if op.to < 0:
        raise Stopped(f"there is no label {op.a}")
    return op.to if op.to > at else _round(run, frame, at, op.to, at + 1)


def _round(run: Running, frame: Frame, at: int, start: int, after: int) -> int:
    """Goes round a loop again that has no condition: from ``start``; or leaves it where an unknown condition could
    have; or ends the program where nothing does.
    """
    ways = [way for step, way in frame.leaving.items() if start <= step < after]
    if ways:  # The one on which most is done: an error does little.
        run.machine.log.choose(
            f"the loop from line {frame.code.ops[start].line} is left after one round"
        )
        for step in [step for step in frame.leaving if start <= step < after]:
            del frame.leaving[step]
        return max(ways, key=lambda way: way[1] - way[0])[0]
    if not _has_way_out(frame.code.ops, start, after) or _stands_still(run, frame, at):
        line = frame.code.ops[start].line if start < len(frame.code.ops) else run.machine.line
        run.machine.log.fact("goes round for ever", f"from line {line}: shown once")
        raise Ended
    return start


def _stands_still(run: Running, frame: Frame, at: int) -> bool:
    """Whether a loop repeats itself: a round before left all names as they are now."""
    return frame.rounds.setdefault(at, LoopRounds()).is_repeated(lambda: _read_names(run))


def _has_way_out(ops: list[Op], start: int, after: int) -> bool:
    return any(
        op.do in _LEAVING
        or (op.to != -1 and not start <= op.to < after and (op.do != "do" or op.a is not None))
        for op in ops[start : after - 1]
    )


def _read_names(run: Running) -> list[dict[Any, object]]:
    """The values of all names, comparable."""
    scopes: list[Mapping[Any, Value]] = [
        run.scope.names,
        run.module_scope.names,
        run.machine.globals,
        run.machine.outputs,
    ]
    return [{name: comparable(value) for name, value in scope.items()} for scope in scopes]


def comparable(value: Value | None) -> object:
    """A value that ``==`` compares."""
    if isinstance(value, Pose):
        return type(value), value.origin, value.rotation.tobytes()
    if isinstance(value, Array):
        return value.tops, {index: comparable(item) for index, item in value.items.items()}
    return value


def start_for(run: Running, frame: Frame, at: int, op: Op) -> int | None:
    """``For``."""
    target, first, last, step = op.a
    begin, end, by = (evaluate(run, node) for node in (first, last, step))
    for value in (begin, end, by):
        if isinstance(value, Unknown):
            run.machine.log.choose(
                f"{value.what} is not known: the loop is gone through once", value.key
            )
            assign(run, target, begin if not isinstance(begin, Unknown) else Unknown(begin.what))
            frame.loops.pop(at, None)
            return None
    numbers = number(begin), number(end), number(by)
    assign(run, target, numbers[0])
    frame.loops[at] = numbers[1:]
    return None if _within(numbers[0], numbers[1], numbers[2]) else op.to


def _within(value: float, end: float, by: float) -> bool:
    return value <= end if by >= 0 else value >= end


def next_for(run: Running, frame: Frame, _at: int, op: Op) -> int | None:
    """``Next``."""
    found = frame.loops.get(op.to)
    if found is None:
        return None
    target = frame.code.ops[op.to].a[0]
    value = evaluate(run, target)
    if isinstance(value, Unknown):
        return None
    count = number(value) + found[1]
    assign(run, target, count)
    return op.to + 1 if _within(count, *found) else None


def enter(run: Running, frame: Frame, at: int, op: Op) -> int | None:
    """``Do [While|Until]`` and ``While``: into the loop, or behind it."""
    if op.a is None:
        return None
    value = evaluate(run, op.a)
    found = truth(value)
    if isinstance(found, Unknown):
        frame.undecided.add(at)
        acting = frame.code.acting
        acts = acting[op.to] - acting[at] > 0
        run.machine.log.choose(
            f"{found.what} is not known: the loop {'is gone through once' if acts else 'ends'}",
            found.key,
        )
        return None if acts else op.to
    return None if found == op.b else op.to


def repeat(run: Running, frame: Frame, at: int, op: Op) -> int | None:
    """``Loop [While|Until]``, ``Wend`` and ``Until``: back, or on."""
    head = frame.code.ops[op.to]
    if op.a is not None:
        found = truth(evaluate(run, op.a))
        if isinstance(found, Unknown):
            run.machine.log.choose(f"{found.what} is not known: the loop ends", found.key)
            return None
        if found != op.b:
            return None
        if not _constant(op.a):
            return _again(run, frame, at, op.to, head)
    elif head.a is not None and not _constant(head.a):
        was_undecided = op.to in frame.undecided
        frame.undecided.discard(op.to)
        if was_undecided and isinstance(truth(evaluate(run, head.a)), Unknown):
            return None
        return _again(run, frame, at, op.to, head)
    return _round(run, frame, at, op.to, at + 1)


def _constant(node: Node) -> bool:
    return node.kind == "number" or (
        node.kind == "name" and node.said in ("true", "on", "false", "off")
    )


def _again(run: Running, frame: Frame, at: int, start: int, head: Op) -> int | None:
    """Round again where a condition holds; where nothing changes it, something outside does, after one round."""
    if _stands_still(run, frame, at):
        run.machine.log.choose(
            f"the condition of the loop from line {head.line} never changes here: the loop is left"
        )
        frame.rounds.pop(at, None)
        return None
    return start


def select(run: Running, frame: Frame, _at: int, op: Op) -> int | None:
    """``Select Case``."""
    value = evaluate(run, op.a)
    if isinstance(value, Unknown):
        run.machine.log.choose(
            f"{value.what} is not known: the first Case that does something is taken", value.key
        )
        return _first_case(frame, op)
    for tests, where in op.b:
        if tests is None or any(_matches(run, value, test) for test in tests):
            return int(where)
    return op.to


def _first_case(frame: Frame, op: Op) -> int:
    starts = [where for _, where in op.b]
    acting = frame.code.acting
    for where, end in zip(starts, [*starts[1:], op.to], strict=False):
        if acting[end] > acting[where] and not _leaves(frame.code.ops, where, end):
            return int(where)
    return int(starts[0]) if starts else op.to


def _matches(run: Running, value: Value, test: tuple[str, Node, Node | None]) -> bool:
    sign, one, other = test
    if sign == "to" and other is not None:
        low, high = evaluate(run, one), evaluate(run, other)
        return bool(calculate(">=", value, low)) and bool(calculate("<=", value, high))
    found = calculate(sign, value, evaluate(run, one))
    return not isinstance(found, Unknown) and bool(found)


def go_sub(run: Running, frame: Frame, at: int, op: Op) -> int:
    """``GoSub``."""
    where = frame.code.labels.get(op.a, -1)
    if where < 0:
        run.machine.log.find("refused", f"there is no label {op.a}")
        return at + 1
    if len(frame.returns) > 100:
        raise Stopped("GoSub without end")
    frame.returns.append(at + 1)
    return where


def on_value(run: Running, frame: Frame, at: int, op: Op) -> int | None:
    """``On n GoTo|GoSub label, label``."""
    word, goals = op.b
    value = evaluate(run, op.a)
    if isinstance(value, Unknown):
        run.machine.log.choose(
            f"{value.what} is not known: the first way of On is taken", value.key
        )
    which = 0 if isinstance(value, Unknown) else int(number(value)) - 1
    if not 0 <= which < len(goals) or goals[which] not in frame.code.labels:
        return None
    if word == "gosub":
        frame.returns.append(at + 1)
    return frame.code.labels[goals[which]]


def on_error(_run: Running, frame: Frame, _at: int, op: Op) -> None:
    """``On Error GoTo label``, or ``GoTo 0``."""
    frame.handler = op.a if op.a in frame.code.labels else ""


def wait_for(run: Running, op: Op) -> None:
    """``Wait condition[, time[, result]]``: over at once, and what it waits for holds from then on."""
    found = truth(evaluate(run, op.a))
    if found is not True:
        asked = run.told_by_user(op.a)
        if found is False and asked:
            raise Stopped(f"waits for ever: {asked} is given otherwise")
        what = found.what if isinstance(found, Unknown) else "what others set"
        run.machine.log.choose(
            f"Wait for {what} is over at once", found.key if isinstance(found, Unknown) else ""
        )
        _learn(run, op.a)
    run.machine.passing = False
    if len(op.b) > 1 and op.b[1].kind in ("name", "index"):
        assign(run, op.b[1], 1.0)


def _learn(run: Running, node: Node) -> None:
    """Takes it that a condition holds which is an equation, or several with And."""
    if node.kind == "and":
        _learn(run, node.parts[0])
        _learn(run, node.parts[1])
    elif node.kind == "=" and node.parts[0].kind in ("name", "index"):
        try:
            value = evaluate(run, node.parts[1])
            if not isinstance(value, Unknown):
                run.learn(node.parts[0], value)
        except Unreadable:
            return
    elif node.kind in ("name", "index"):
        run.learn(node, 1.0)


def take_input(run: Running, op: Op) -> None:
    """``Input`` and what else fills variables from outside."""
    nodes = op.a if op.b in ("input", "lineinput", "com_state") else op.a[:1]
    for node in nodes:
        if node.kind in ("name", "index", "call"):
            said = str(node.said)
            assign(run, node, run.machine.unknown(f"{said} from {op.b}", said))


__all__ = ["assign_name"]
