"""The choices of a RAPID run in words: branches and loops that the text does not determine."""

from __future__ import annotations

from camgen.lang.code import Act, CountStart, Select, Step
from camgen.lang.flow import Choice
from camgen.lang.values import Unknown

from .code import Question
from .machine import Machine
from .tree import Expr, Label, Negation, Operation, Ref
from .values import Value

_COMPARES = frozenset(("=", "<>", "<", "<=", ">", ">="))
#: Negations and operators of a condition that are looked through for the value that decides.
_DEEPEST_CONDITION = 20
#: Text of each choice that depends on an unknown value, and whether its condition holds then.
_WORDS = {
    Choice.BRANCH_ENTERED: ("an IF depends on {}: it is assumed to hold", True),
    Choice.BRANCH_PASSED: ("an IF depends on {}: it is assumed not to hold", False),
    Choice.LOOP_RUN_ONCE: ("a loop depends on {}: it is run once", True),
    Choice.LOOP_ENDED: ("a loop depends on {}: it ends at once", False),
}


def log_choice(
    machine: Machine, choice: Choice, step: Step, unknown: Unknown | None, length: int
) -> None:
    """Add a choice of the engine to the log. A loop that repeats itself is shown once."""
    log, condition = machine.log, getattr(step, "condition", None)
    if unknown is None:
        if choice is not Choice.LOOP_LEFT:
            is_waiting = length == len(machine.body)
            machine.cut(length)
            if choice is Choice.LOOP_REPEATS and is_waiting:
                log.assume("a loop waits for what nothing in it changes: it ends at once")
                return
        name = _name_loop(step) if choice is Choice.LOOP_ENDLESS else "a loop repeats"
        log.assume(f"{name}: it is shown once")
    elif isinstance(step, Select):
        _log_case(machine, step, unknown, length)
    elif isinstance(step, CountStart):
        log.assume(f"a FOR counts to {describe(unknown)}: it is run once", unknown.key)
    elif condition is not None and isinstance(condition.value, Question):
        words, holds = _WORDS[choice]
        key, value = hint(machine, condition.value.value, unknown, holds)
        log.assume(words.format(describe(unknown)), key, value)


def _name_loop(step: Step) -> str:
    label = step.operand if isinstance(step, Act) else None
    words = f"GOTO {label.name}" if isinstance(label, Label) else "WHILE TRUE"
    return f"{words} repeats without end"


def _log_case(machine: Machine, step: Select, unknown: Unknown, number: int) -> None:
    tests = step.cases[number].tests if step.cases else None
    if tests is None:
        machine.log.assume(f"a TEST depends on {describe(unknown)}: the case DEFAULT is taken")
        return
    value = machine.value(tests[0])
    if type(value) is float:
        case, key, given = f"{value:g}", unknown.key, value
    elif isinstance(value, Unknown):
        case, key, given = describe(value), "", 0.0
    else:
        case, key, given = ascii(value)[:40], "", 0.0
    machine.log.assume(
        f"a TEST depends on {describe(unknown)}: the case {case} is taken", key, given
    )


def describe(unknown: Unknown) -> str:
    """Return the source of an unknown value."""
    return unknown.what[:60] or "what is not known"


def hint(machine: Machine, condition: Expr, unknown: Unknown, holds: bool) -> tuple[str, float]:
    """Return key and value with which the user sets the unknown value of a condition.

    holds: whether the condition holds with this value.
    """
    expr = condition
    for _ in range(_DEEPEST_CONDITION):
        if isinstance(expr, Negation):
            holds, expr = not holds, expr.value
        elif isinstance(expr, Operation) and expr.sign in ("and", "or", "xor"):
            left = _plain(machine, expr.left)
            expr = expr.right if left is not None and not isinstance(left, Unknown) else expr.left
        else:
            break
    if not isinstance(expr, Operation) or expr.sign not in _COMPARES:
        return unknown.key, float(holds)
    sides = [_plain(machine, expr.left), _plain(machine, expr.right)]
    if any(isinstance(side, (str, tuple)) for side in sides):
        return "", 0.0
    number = next((float(v) for v in sides if type(v) in (float, bool)), 1.0)
    if expr.sign in ("=", "<>"):
        other = 1.0 - number if number in (0.0, 1.0) else number + 1.0
        return unknown.key, number if holds == (expr.sign == "=") else other
    more = (expr.sign in (">", ">=")) == holds
    # The number is on the left of the operator.
    if sides[0] is not None and not isinstance(sides[0], Unknown):
        more = not more
    return unknown.key, number + 1.0 if more else number - 1.0


def _plain(machine: Machine, expr: Expr) -> Value:
    """Return the value of an expression without calls, None for others: a call may have effects."""
    if isinstance(expr, (Ref, float, bool, str)):
        return machine.value(expr)
    return None
