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


def test_branches_lead_to_the_step_after_their_block() -> None:
    """If a, step 1 runs, else if b, step 4, else step 6."""
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


def test_a_loop_leads_back_to_its_start_and_an_exit_to_the_step_after_it() -> None:
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


def test_the_end_of_a_round_leads_to_the_end_of_its_loop() -> None:
    compiler = Compiler()
    outer = compiler.open("while", LoopStart(0, condition=Condition("a")))
    inner = compiler.open("do", LoopStart(0))
    assert compiler.end_round(["while"])
    assert compiler.end_round(["do", "while"])
    assert not compiler.end_round(["for"])
    compiler.blocks.pop()
    compiler.close_loop(inner)
    compiler.close_loop(outer)
    steps = compiler.finish().steps
    assert [step.to for step in steps] == [6, 5, 5, 4, 1, 0]


def test_each_case_leads_to_the_step_after_its_block() -> None:
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


def test_a_label_may_follow_its_jump_and_the_first_of_two_labels_counts() -> None:
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
def test_a_step_leaves_if_it_ends_the_routine_or_jumps_out(step: Step, is_leaving: bool) -> None:
    assert leaves(step) == is_leaving


def test_a_span_acts_or_leaves_if_a_step_of_it_does() -> None:
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


def test_empty_cases_lead_to_the_step_after_their_block() -> None:
    compiler = Compiler()
    block = compiler.open("select", Select(1, value="a", cases=[]))
    for tests in ([1], [2]):
        compiler.end_case(block)
        compiler.add_case(block, tests)
    compiler.add(act(2))
    compiler.close(compiler.blocks.pop())
    assert [case.to for case in block.first.cases] == [1, 2]  # type: ignore[attr-defined]
    assert list_targets(compiler) == [3, 3, -1]


@pytest.mark.parametrize("exit_kind", ["condition", "exit", "return", "jump", "none"])
def test_a_loop_is_endless_if_no_step_leads_out_of_it(exit_kind: str) -> None:
    compiler = Compiler()
    condition = Condition("a") if exit_kind == "condition" else None
    block = compiler.open("do", LoopStart(1, condition=condition))
    if exit_kind == "exit":
        compiler.exit(["do"])
    elif exit_kind == "return":
        compiler.add(Return(2))
    elif exit_kind == "jump":
        compiler.jump("end")
    compiler.close_loop(compiler.blocks.pop())
    compiler.mark("end")
    code = compiler.finish()
    assert code.is_endless(range(block.start, len(code.steps))) == (exit_kind == "none")
