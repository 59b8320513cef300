"""A routine as steps: blocks, labels, and properties of spans of steps."""

from __future__ import annotations

import pytest

from camgen.lang.code import (
    Act,
    Branch,
    Compiler,
    Condition,
    CountStart,
    Effect,
    End,
    Jump,
    LoopStart,
    Raise,
    Resume,
    Return,
    Select,
    Step,
    leaves,
)


def do_nothing(_language: object, _operand: object) -> None:
    """An action."""


def act(line: int, effect: Effect = Effect.NONE) -> Act:
    """A step that the language carries out."""
    return Act(line, do=do_nothing, effect=effect)


def list_targets(compiler: Compiler) -> list[int]:
    """The `to` of each step."""
    return [step.to for step in compiler.finish().steps]


def test_branches_end_behind_their_block() -> None:
    """If a: 1, else if b: 3, else: 6."""
    compiler = Compiler()
    block = compiler.open_branch("if", Condition("a"))
    compiler.add(act(1))
    compiler.add_alternative(block)
    compiler.add_condition(block, Condition("b"))
    compiler.add(act(2))
    compiler.add_alternative(block)
    compiler.add(act(3))
    compiler.close(compiler.blocks.pop())
    assert [type(step) for step in compiler.steps] == [Branch, Act, Jump, Branch, Act, Jump, Act]
    assert list_targets(compiler) == [3, -1, 7, 6, -1, 7, -1]


def test_a_branch_without_an_alternative_leads_to_its_end() -> None:
    compiler = Compiler()
    compiler.open_branch("if", Condition("a"))
    compiler.add(act(1))
    compiler.close(compiler.blocks.pop())
    assert list_targets(compiler) == [2, -1]
    code = compiler.finish()
    assert code.list_branches(0) == (range(1, 2), range(2, 2))


def test_the_alternative_of_a_branch_ends_before_the_end_of_its_block() -> None:
    compiler = Compiler()
    block = compiler.open_branch("if", Condition("a"))
    compiler.add(act(1))
    compiler.add_alternative(block)
    compiler.add(act(2))
    compiler.add(act(3))
    compiler.close(compiler.blocks.pop())
    assert compiler.finish().list_branches(0) == (range(1, 2), range(3, 5))


def test_loops_lead_back_to_their_start_and_behind_their_end() -> None:
    compiler = Compiler()
    outer = compiler.open("for", CountStart(1, count="i"))
    inner = compiler.open("do", LoopStart(2))
    assert compiler.exit(["for"])
    assert compiler.exit(["do", "while"])
    assert not compiler.exit(["while"])
    compiler.blocks.pop()
    compiler.close_loop(inner)
    compiler.blocks.pop()
    compiler.close_count(outer)
    assert list_targets(compiler) == [6, 5, 6, 5, 1, 0]


def test_each_case_leads_behind_the_block() -> None:
    compiler = Compiler()
    block = compiler.open("select", Select(1, value="a", cases=[]))
    for tests in ([1], [2, 3], None):
        compiler.end_case(block)
        compiler.add_case(block, tests)
        compiler.add(act(2))
    compiler.close(compiler.blocks.pop())
    select = compiler.steps[0]
    assert isinstance(select, Select)
    assert [(case.tests, case.to) for case in select.cases] == [([1], 1), ([2, 3], 3), (None, 5)]
    assert list_targets(compiler) == [6, -1, 6, -1, 6, -1]


def test_labels_are_found_ahead_and_the_first_of_two_counts() -> None:
    compiler = Compiler()
    compiler.jump("end")
    assert compiler.mark("start")
    compiler.add(act(2))
    assert not compiler.mark("start")
    compiler.jump("start")
    compiler.jump("missing")
    compiler.mark("end")
    assert list_targets(compiler) == [4, -1, 1, -1]


@pytest.mark.parametrize(
    ("step", "is_leaving"),
    [
        (Return(1), True),
        (Raise(1), True),
        (Resume(1, is_again=True), False),
        (End(1), True),
        (Jump(1, 5), False),
        (Jump(1, 5, label="a"), True),
        (Jump(1, 5, is_exit=True), True),
        (act(1, Effect.LEAVES), True),
        (act(1, Effect.MOVES), False),
        (Branch(1, 5, condition=Condition("a")), False),
    ],
)
def test_steps_that_leave_for_good(step: Step, is_leaving: bool) -> None:
    assert leaves(step) == is_leaving


def test_spans_that_act_and_that_leave() -> None:
    compiler = Compiler()
    for effect in (Effect.NONE, Effect.ACTS, Effect.NONE, Effect.MOVES, Effect.LEAVES):
        compiler.add(act(1, effect))
    code = compiler.finish()
    assert [code.acts(range(k, k + 1)) for k in range(5)] == [False, True, False, True, False]
    assert code.acts(range(5))
    assert code.leaves(range(5))
    assert not code.leaves(range(4))
    assert not code.leaves(range(5, 5))


@pytest.mark.parametrize(("is_inner", "is_leaving"), [(False, True), (True, False)])
def test_a_span_leaves_by_a_step_outside_of_its_inner_blocks(
    is_inner: bool, is_leaving: bool
) -> None:
    compiler = Compiler()
    compiler.open_branch("if", Condition("a"))
    if is_inner:
        compiler.open_branch("if", Condition("b"))
    compiler.add(Return(1))
    if is_inner:
        compiler.close(compiler.blocks.pop())
    compiler.add(act(2))
    compiler.close(compiler.blocks.pop())
    branch = compiler.finish().steps[0]
    assert isinstance(branch, Branch)
    assert branch.is_leaving == is_leaving


def test_an_empty_case_leads_behind_the_block() -> None:
    compiler = Compiler()
    block = compiler.open("select", Select(1, value="a", cases=[]))
    for tests in ([1], [2]):
        compiler.end_case(block)
        compiler.add_case(block, tests)
    compiler.add(act(2))
    compiler.close(compiler.blocks.pop())
    assert [case.to for case in block.first.cases] == [1, 2]  # type: ignore[attr-defined]
    assert list_targets(compiler) == [3, 3, -1]


@pytest.mark.parametrize("way_out", ["condition", "exit", "return", "jump", "none"])
def test_a_loop_is_endless_if_no_step_leads_out_of_it(way_out: str) -> None:
    compiler = Compiler()
    condition = Condition("a") if way_out == "condition" else None
    block = compiler.open("do", LoopStart(1, condition=condition))
    if way_out == "exit":
        compiler.exit(["do"])
    elif way_out == "return":
        compiler.add(Return(2))
    elif way_out == "jump":
        compiler.jump("end")
    compiler.close_loop(compiler.blocks.pop())
    compiler.mark("end")
    code = compiler.finish()
    assert code.is_endless(range(block.start, len(code.steps))) == (way_out == "none")
