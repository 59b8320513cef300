"""The run of steps with a toy language, whose expressions are Python and variables a dictionary."""

from __future__ import annotations

from typing import Any

import pytest

from camgen.lang.code import (
    Act,
    Call,
    Compiler,
    Condition,
    CountStart,
    Effect,
    End,
    Handle,
    Jump,
    JumpTable,
    LoopStart,
    Raise,
    Resume,
    Return,
    Select,
    Step,
)
from camgen.lang.flow import Choice, Counter, Flow, Raised, Rules
from camgen.lang.log import Log
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown


class Toy:
    """A toy language.

    A name that starts with x is unknown. It is guessed to hold if it starts with xt, and not to
    hold if it starts with xf.

    done: operands of the actions so far.
    settable: unknown names of which any choice can be made, all without a guess.
    """

    faults: type[Exception] = ZeroDivisionError

    def __init__(self, limit: float = 10_000, rules: Rules | None = None) -> None:
        self.log = Log(lambda: self.line)
        self.line = 0
        self.names: dict[str, Any] = {}
        self.done: list[Any] = []
        self.choices: list[tuple[Choice, int]] = []
        self.compiler = Compiler()
        self.settable: set[str] = set()
        self.flow = Flow(self, Budget(0, limit, "toy_steps"), rules or Rules(depth_limit=3))

    def begin(self, step: Step) -> None:
        self.line = step.line

    def evaluate(self, expression: str) -> Any:
        if expression[0] != "x":
            return eval(expression, {}, self.names)
        return Unknown(expression, guess={"t": True, "f": False}.get(expression[1:2]))

    def to_number(self, value: float) -> float:
        return float(value)

    def matches(self, value: object, tests: list[object]) -> bool | Unknown:
        return Unknown("x") if "x" in tests else value in tests

    def open_count(self, count: str) -> Counter:
        name, first, last, step = count.split()
        if "x" in (first, last, step):
            return Counter(name, 1.0, unknown=Unknown("x"))
        return Counter(name, float(first), float(last), float(step))

    def assign(self, target: str, value: float) -> None:
        self.names[target] = value

    def read_state(self) -> object:
        return dict(self.names)

    def count_instructions(self) -> int:
        return len(self.done)

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        del self.done[length or len(self.done) :]
        if unknown is not None and unknown.guess is not None:
            wanted = choice in (Choice.BRANCH_ENTERED, Choice.LOOP_ENDED)
            if choice is not Choice.LOOP_LIMITED and unknown.guess != wanted:
                return unknown.what in self.settable
        self.choices.append((choice, step.line))
        return True

    def report(self, step: Step, error: Exception) -> None:
        self.log.find("refused", f"{error}", line=step.line)

    # A program of the toy.

    def do(self, code: str, effect: Effect = Effect.NONE) -> None:
        """Add an action: a Python assignment, or a name that is only recorded."""
        self.compiler.line += 1
        self.compiler.add(Act(self.compiler.line, do=Toy.act, operand=code, effect=effect))

    def act(self, code: str) -> None:
        self.done.append(code)
        if "=" in code:
            exec(code, {}, self.names)

    def run(self) -> Toy:
        """Run the routine to its end."""
        try:
            self.flow.run(self.compiler.finish())
        except Ended:
            self.done.append("ended")
        return self


def open_branch(toy: Toy, condition: Condition) -> None:
    toy.compiler.line += 1
    toy.compiler.open_branch("if", condition)


def add_alternative(toy: Toy) -> None:
    toy.compiler.line += 1
    toy.compiler.add_alternative(toy.compiler.blocks[-1])


def close(toy: Toy) -> None:
    toy.compiler.line += 1
    toy.compiler.close(toy.compiler.blocks.pop())


def open_loop(toy: Toy, condition: str = "") -> None:
    toy.compiler.line += 1
    start = LoopStart(toy.compiler.line, condition=Condition(condition) if condition else None)
    toy.compiler.open("do", start)


def close_loop(toy: Toy, condition: Condition | None = None) -> None:
    toy.compiler.line += 1
    toy.compiler.close_loop(toy.compiler.blocks.pop(), condition)


# -- branches ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("condition", "done"), [("1 < 2", ["a", "c"]), ("1 > 2", ["b", "c"])])
def test_a_known_condition_chooses_its_branch(condition: str, done: list[str]) -> None:
    toy = Toy()
    open_branch(toy, Condition(condition))
    toy.do("a")
    add_alternative(toy)
    toy.do("b")
    close(toy)
    toy.do("c")
    assert toy.run().done == done
    assert not toy.choices


@pytest.mark.parametrize(
    ("first", "second", "is_unlikely", "done"),
    [
        (Effect.MOVES, Effect.NONE, False, "a"),
        (Effect.NONE, Effect.MOVES, False, "b"),
        (Effect.NONE, Effect.NONE, False, "a"),
        (Effect.NONE, Effect.NONE, True, "b"),
        (Effect.LEAVES, Effect.NONE, False, "b"),
        (Effect.NONE, Effect.LEAVES, True, "a"),
        (Effect.LEAVES, Effect.LEAVES, False, "a"),
    ],
)
def test_an_unknown_condition_enters_the_branch_that_stays_and_acts(
    first: Effect, second: Effect, is_unlikely: bool, done: str
) -> None:
    toy = Toy()
    open_branch(toy, Condition("x", is_unlikely=is_unlikely))
    toy.do("a", first)
    add_alternative(toy)
    toy.do("b", second)
    close(toy)
    assert toy.run().done == [done]
    choice = Choice.BRANCH_ENTERED if done == "a" else Choice.BRANCH_PASSED
    assert toy.choices == [(choice, 1)]


@pytest.mark.parametrize(
    ("value", "done"), [("1", ["a"]), ("3", ["b"]), ("9", ["c"]), ("x", ["b"])]
)
def test_a_value_selects_its_case_and_an_unknown_one_a_case_that_acts(
    value: str, done: list[str]
) -> None:
    toy = Toy()
    block = toy.compiler.open("select", Select(1, value=value, cases=[]))
    for tests, action in (([1], "a"), ([2, 3], "b"), (None, "c")):
        toy.compiler.end_case(block)
        toy.compiler.add_case(block, tests)
        toy.do(action, Effect.MOVES if action == "b" else Effect.NONE)
    close(toy)
    assert toy.run().done == done
    assert toy.choices == ([(Choice.FIRST_CASE, 1)] if value == "x" else [])


@pytest.mark.parametrize(("value", "done"), [("1", ["a"]), ("9", ["c"]), ("5", ["c"])])
def test_an_unknown_case_leaves_the_choice_open(value: str, done: list[str]) -> None:
    """A later case that is selected counts. No case acts, and the first two leave."""
    toy = Toy()
    block = toy.compiler.open("select", Select(1, value=value, cases=[]))
    for tests, action in (([1], "a"), (["x"], "b"), ([9], "c")):
        toy.compiler.end_case(block)
        toy.compiler.add_case(block, tests)
        toy.do(action, Effect.LEAVES if action != "c" else Effect.NONE)
    close(toy)
    assert toy.run().done == done
    assert toy.choices == ([(Choice.FIRST_CASE, 1)] if value == "5" else [])


# -- loops -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "rounds"),
    [("i 1 3 1", 3), ("i 3 1 -1", 3), ("i 2 1 1", 0), ("i 0 1 0.25", 5), ("i 1 x 1", 1)],
)
def test_a_counted_loop_runs_for_each_value(count: str, rounds: int) -> None:
    toy = Toy()
    block = toy.compiler.open("for", CountStart(1, count=count))
    toy.do("done")
    toy.compiler.blocks.pop()
    toy.compiler.close_count(block)
    assert toy.run().done == ["done"] * rounds
    assert toy.choices == ([(Choice.LOOP_RUN_ONCE, 1)] if "x" in count else [])


@pytest.mark.parametrize("is_at_end", [False, True])
def test_a_loop_runs_while_its_condition_holds(is_at_end: bool) -> None:
    toy = Toy()
    toy.do("n = 0")
    open_loop(toy, "" if is_at_end else "n < 3")
    toy.do("n = n + 1")
    close_loop(toy, Condition("n >= 3", wanted=False) if is_at_end else None)
    assert toy.run().done == ["n = 0"] + ["n = n + 1"] * 3


@pytest.mark.parametrize(
    ("effect", "choice"),
    [(Effect.MOVES, Choice.LOOP_RUN_ONCE), (Effect.NONE, Choice.LOOP_ENDED)],
)
def test_a_loop_with_an_unknown_condition_runs_once_if_it_acts(
    effect: Effect, choice: Choice
) -> None:
    toy = Toy()
    open_loop(toy, "x")
    toy.do("a", effect)
    close_loop(toy)
    toy.do("b")
    assert toy.run().done == (["a", "b"] if effect is Effect.MOVES else ["b"])
    assert toy.choices == [(choice, 1)]


def test_a_loop_with_an_unknown_condition_is_passed_if_it_leaves_for_good() -> None:
    toy = Toy()
    open_loop(toy, "x")
    toy.do("a", Effect.MOVES)
    toy.compiler.add(Return(2))
    close_loop(toy)
    toy.do("b")
    assert toy.run().done == ["b"]
    assert toy.choices == [(Choice.LOOP_ENDED, 1)]


def test_an_unknown_condition_is_compared_with_each_alternative() -> None:
    """The first alternative acts and leaves. The last one does neither, so that nothing acts."""
    toy = Toy()
    open_branch(toy, Condition("x"))
    toy.do("a")
    add_alternative(toy)
    toy.compiler.add_condition(toy.compiler.blocks[-1], Condition("1 < 2"))
    toy.do("b", Effect.MOVES)
    toy.compiler.add(Return(2))
    add_alternative(toy)
    toy.do("c")
    close(toy)
    assert toy.run().done == ["a"]
    assert toy.choices == [(Choice.BRANCH_ENTERED, 1)]


def ask_in_a_loop(toy: Toy) -> None:
    """The body of a loop: "a" if an unknown value holds, else "b"."""
    open_branch(toy, Condition("x"))
    toy.do("a")
    add_alternative(toy)
    toy.do("b")
    close(toy)


def test_a_loop_that_asks_for_the_same_value_again_takes_the_other_branch() -> None:
    """An answer of the operator ends such a loop, so it differs between rounds."""
    toy = Toy()
    toy.names["count"] = 0
    open_loop(toy, "count < 3")
    toy.do("count = count + 1")
    ask_in_a_loop(toy)
    close_loop(toy)
    actions = [action for action in toy.run().done if "=" not in action]
    assert actions == ["a", "b", "b"]
    assert [choice for choice, _ in toy.choices] == [
        Choice.BRANCH_ENTERED,
        Choice.BRANCH_PASSED,
        Choice.BRANCH_PASSED,
    ]


def test_a_counted_loop_takes_the_same_branch_in_each_round() -> None:
    toy = Toy()
    toy.compiler.open("for", CountStart(1, count="i 1 3 1"))
    ask_in_a_loop(toy)
    toy.compiler.close_count(toy.compiler.blocks.pop())
    assert toy.run().done == ["a", "a", "a"]


def test_a_loop_whose_condition_never_changes_is_left() -> None:
    toy = Toy()
    open_loop(toy, "1 < 2")
    toy.do("a")
    close_loop(toy)
    toy.do("b")
    assert toy.run().done[-1] == "b"
    assert toy.choices == [(Choice.LOOP_REPEATS, 1)]


@pytest.mark.parametrize("condition", [None, Condition("1 < 2", is_constant=True)])
def test_a_loop_without_an_exit_ends_the_program_after_one_round(
    condition: Condition | None,
) -> None:
    toy = Toy()
    open_loop(toy)
    toy.do("n = 0")
    close_loop(toy, condition)
    toy.do("b")
    assert toy.run().done == ["n = 0", "ended"]
    assert toy.choices == [(Choice.LOOP_ENDLESS, 1)]


def test_a_loop_is_left_by_an_unknown_branch_that_has_an_exit() -> None:
    """The longer of two such branches is run."""
    toy = Toy()
    open_loop(toy)
    for actions in (["a"], ["b", "c"]):
        open_branch(toy, Condition("x"))
        for action in actions:
            toy.do(action)
        toy.compiler.exit(["do"])
        close(toy)
    toy.do("d")
    close_loop(toy)
    toy.do("e")
    assert toy.run().done == ["d", "b", "c", "e"]
    assert toy.choices[-1] == (Choice.LOOP_LEFT, 1)


@pytest.mark.parametrize(("limit", "choice"), [(20, Choice.LOOP_ENDLESS), (None, None)])
def test_a_loop_without_a_condition_has_a_limit_of_rounds(
    limit: int | None, choice: Choice | None
) -> None:
    """Its state changes in each round. The toy keeps the actions of the first round."""
    toy = Toy(limit=200, rules=Rules(depth_limit=3, round_limit=limit))
    toy.do("n = 0")
    open_loop(toy)
    toy.do("n = n + 1")
    open_branch(toy, Condition("n < 0"))
    toy.compiler.exit(["do"])
    close(toy)
    close_loop(toy)
    if choice is None:
        with pytest.raises(Stopped, match="toy_steps"):
            toy.run()
        return
    assert toy.run().done == ["n = 0", "n = n + 1", "ended"]
    assert toy.names == {"n": 21}
    assert toy.choices == [(choice, 2)]


def test_a_jump_back_is_a_loop() -> None:
    toy = Toy()
    toy.do("n = 0")
    toy.compiler.mark("again")
    toy.do("n = n + 1")
    open_branch(toy, Condition("n < 4"))
    toy.compiler.jump("again")
    close(toy)
    assert toy.run().names == {"n": 4}


# -- guessed conditions ------------------------------------------------------------------------

GUESSING = Rules(depth_limit=3, rounds=2, skips_blocks=True)


@pytest.mark.parametrize(
    ("condition", "effect", "settable", "done"),
    [
        ("xt", Effect.NONE, False, ["a", "b"]),
        ("xf", Effect.MOVES, False, ["b"]),
        ("xt", Effect.LEAVES, False, ["a", "b"]),
        ("xt", Effect.LEAVES, True, ["b"]),
    ],
)
def test_a_guess_decides_unless_its_branch_leaves_and_another_value_is_allowed(
    condition: str, effect: Effect, settable: bool, done: list[str]
) -> None:
    toy = Toy(rules=GUESSING)
    toy.settable = {condition} if settable else set()
    open_branch(toy, Condition(condition))
    toy.do("a", effect)
    close(toy)
    toy.do("b")
    assert toy.run().done == done


@pytest.mark.parametrize(
    ("condition", "is_at_end", "settable", "rounds"),
    [
        ("xt", False, False, 2),
        ("xf", False, False, 0),
        ("xt", True, False, 1),
        ("xf", True, False, 2),
        ("xf", True, True, 1),
    ],
)
def test_a_loop_with_a_guessed_condition_has_the_rounds_of_the_rules(
    condition: str, is_at_end: bool, settable: bool, rounds: int
) -> None:
    """A condition at the end of the loop ends it if it holds."""
    toy = Toy(rules=GUESSING)
    toy.settable = {condition} if settable else set()
    open_loop(toy, "" if is_at_end else condition)
    toy.do("a")
    close_loop(toy, Condition(condition, wanted=False) if is_at_end else None)
    toy.do("b")
    assert toy.run().done == ["a"] * rounds + ["b"]


@pytest.mark.parametrize("has_condition", [False, True])
def test_a_program_with_guesses_continues_after_a_loop_that_repeats_itself(
    has_condition: bool,
) -> None:
    """Only one round of the loop is in the program."""
    toy = Toy(rules=GUESSING)
    open_loop(toy, "1 < 2" if has_condition else "")
    toy.do("a")
    close_loop(toy)
    toy.do("b")
    assert toy.run().done == ["a", "b"]
    assert toy.choices == [(Choice.LOOP_REPEATS, 1)]


def test_a_block_is_skipped_if_its_condition_cannot_be_evaluated() -> None:
    for rules, done in ((GUESSING, ["b"]), (None, ["a", "b"])):
        toy = Toy(rules=rules)
        open_branch(toy, Condition("1 / 0"))
        toy.do("a")
        close(toy)
        toy.do("b")
        assert toy.run().done == done


@pytest.mark.parametrize("is_at_end", [False, True])
def test_a_loop_that_is_entered_again_has_no_earlier_states(is_at_end: bool) -> None:
    """Both calls leave the same states after the rounds of the loop."""
    toy = Toy()
    for _ in range(2):
        toy.compiler.add(Call(1, label="sub"))
    toy.compiler.add(End(2))
    toy.compiler.mark("sub")
    toy.do("n = 0")
    open_loop(toy, "" if is_at_end else "n < 1")
    toy.do("n = n + 1")
    close_loop(toy, Condition("n >= 2", wanted=False) if is_at_end else None)
    toy.compiler.add(Return(3, is_to_call=True))
    rounds = 2 if is_at_end else 1
    assert toy.run().done == (["n = 0"] + ["n = n + 1"] * rounds) * 2 + ["ended"]
    assert not toy.choices


@pytest.mark.parametrize("condition", ["n < 9", ""])
def test_a_loop_that_was_left_by_an_exit_has_no_earlier_states(condition: str) -> None:
    toy = Toy()
    for _ in range(2):
        toy.compiler.add(Call(1, label="sub"))
    toy.compiler.add(End(2))
    toy.compiler.mark("sub")
    toy.do("n = 0")
    open_loop(toy, condition)
    open_branch(toy, Condition("n == 1"))
    toy.compiler.exit(["do"])
    close(toy)
    toy.do("n = n + 1")
    close_loop(toy)
    toy.compiler.add(Return(3, is_to_call=True))
    assert toy.run().done == ["n = 0", "n = n + 1"] * 2 + ["ended"]
    assert not toy.choices


def test_a_jump_that_repeats_itself_is_found_each_time_that_it_is_reached() -> None:
    toy = Toy(limit=200, rules=GUESSING)
    block = toy.compiler.open("for", CountStart(1, count="i 1 20 1"))
    toy.compiler.mark("again")
    toy.do("a")
    toy.compiler.jump("again")
    toy.compiler.blocks.pop()
    toy.compiler.close_count(block)
    assert toy.run().names == {"i": 21}
    assert toy.choices == [(Choice.LOOP_REPEATS, 1)] * 20


def test_a_jump_into_a_counted_loop_that_has_ended_does_not_count() -> None:
    toy = Toy()
    toy.do("n = 0")
    block = toy.compiler.open("for", CountStart(1, count="i 1 2 1"))
    toy.compiler.mark("inside")
    toy.do("n = n + 1")
    toy.compiler.blocks.pop()
    toy.compiler.close_count(block)
    open_branch(toy, Condition("n < 5"))
    toy.compiler.jump("inside")
    close(toy)
    assert toy.run().names == {"n": 5, "i": 3}


# -- jumps, calls and errors -------------------------------------------------------------------


def test_a_missing_label_stops_the_run() -> None:
    toy = Toy()
    toy.compiler.jump("nowhere")
    with pytest.raises(Stopped, match="there is no label nowhere"):
        toy.run()


def test_a_call_of_a_label_returns() -> None:
    toy = Toy()
    toy.compiler.add(Call(1, label="sub"))
    toy.compiler.add(Call(2, label="missing"))
    toy.do("a")
    toy.compiler.add(End(3))
    toy.compiler.mark("sub")
    toy.do("b")
    toy.compiler.add(Return(4, is_to_call=True))
    assert toy.run().done == ["b", "a", "ended"]
    assert [finding.what for finding in toy.log.list_findings()] == ["there is no label missing"]


def test_a_label_that_calls_itself_stops_the_run() -> None:
    toy = Toy()
    toy.compiler.mark("sub")
    toy.compiler.add(Call(1, label="sub"))
    with pytest.raises(Stopped):
        toy.run()


@pytest.mark.parametrize(
    ("value", "done"), [("1", ["b"]), ("2", ["c"]), ("3", ["a"]), ("0", ["a"]), ("x", ["b"])]
)
def test_a_number_chooses_its_label(value: str, done: list[str]) -> None:
    toy = Toy()
    labels = ["one", "two", "missing"]
    toy.compiler.add(JumpTable(1, value=value, labels=labels, is_call=False))
    for label, action in (("", "a"), ("one", "b"), ("two", "c")):
        toy.compiler.mark(label)
        toy.do(action)
        toy.compiler.add(Return(2))
    assert toy.run().done == done


def test_an_error_runs_the_handler_and_ends_the_program_without_one() -> None:
    toy = Toy()
    toy.compiler.add(Handle(1, label="handler"))
    toy.compiler.add(Raise(2))
    toy.do("a")
    toy.compiler.mark("handler")
    toy.compiler.add(Handle(3, label=""))
    toy.do("b")
    toy.compiler.add(Raise(4))
    with pytest.raises(Raised):
        toy.run()
    assert toy.done == ["b"]


def add_handled(toy: Toy, error: str, *, is_again: bool) -> None:
    """Add a block that ends if n >= 2, a step that raises an error if n < 2, and its handler."""

    def fail(toy: Toy, line: int) -> None:
        if toy.names["n"] < 2:
            raise Raised(line)

    toy.compiler.add(Handle(1, label="handler"))
    toy.do("n = 0")
    toy.compiler.add(Act(7, do=fail, operand=7))
    toy.do("a")
    toy.compiler.add(Return(8))
    toy.compiler.mark("handler")
    toy.compiler.add(Handle(9, label=""))
    toy.do(error)
    toy.compiler.add(Handle(9, label="handler"))
    toy.compiler.add(Resume(9, is_again=is_again))


@pytest.mark.parametrize(("is_again", "count"), [(True, 2), (False, 1)])
def test_a_handler_ends_with_the_step_that_failed_or_the_one_after_it(
    is_again: bool, count: int
) -> None:
    toy = Toy()
    add_handled(toy, "n = n + 1", is_again=is_again)
    assert toy.run().done == ["n = 0", *["n = n + 1"] * count, "a"]


def test_an_error_that_its_handler_repeats_stops_the_run() -> None:
    toy = Toy()
    add_handled(toy, "b", is_again=True)
    with pytest.raises(Stopped, match="an error comes again after 5 tries"):
        toy.run()
    assert toy.done == ["n = 0", *["b"] * 5]


@pytest.mark.parametrize(("is_again", "line"), [(True, 2), (False, 4)])
def test_a_handler_raises_its_error_again_or_another_one(is_again: bool, line: int) -> None:
    toy = Toy()
    toy.compiler.add(Handle(1, label="handler"))
    toy.compiler.add(Raise(2))
    toy.compiler.mark("handler")
    toy.compiler.add(Handle(3, label=""))
    toy.compiler.add(Raise(4, is_again=is_again))
    with pytest.raises(Raised) as raised:
        toy.run()
    assert raised.value.line == line


def test_a_step_that_fails_is_reported_and_skipped() -> None:
    toy = Toy()
    toy.do("n = 1 / 0")
    toy.do("b")
    assert toy.run().done == ["n = 1 / 0", "b"]
    assert [finding.line for finding in toy.log.list_findings()] == [1]


# -- limits ------------------------------------------------------------------------------------


def test_the_budget_counts_each_step() -> None:
    for limit, is_enough in ((2, True), (1, False)):
        toy = Toy(limit)
        toy.do("a")
        toy.do("b")
        if is_enough:
            toy.run()
        else:
            with pytest.raises(Stopped, match=r"toy_steps"):
                toy.run()
        assert len(toy.done) == limit


def test_nested_calls_have_a_limit_of_depth() -> None:
    toy = Toy()
    depth = 0

    def call(toy: Toy, _operand: object) -> None:
        nonlocal depth
        toy.flow.check_depth("too deep")
        depth += 1
        toy.flow.run(code)

    toy.compiler.add(Act(1, do=call))
    code = toy.compiler.finish()
    with pytest.raises(Stopped, match="too deep"):
        toy.flow.run(code)
    assert depth == 3
    depth = 0
    with pytest.raises(Stopped, match="too deep"):
        toy.flow.run(code)
    assert depth == 3


def test_an_action_may_return_the_step_that_replaces_it() -> None:
    toy = Toy()
    toy.do("a")
    toy.compiler.add(Act(2, do=lambda _toy, at: Jump(2, at), operand=3))
    toy.do("passed over")
    toy.do("b")
    toy.compiler.add(Act(5, do=lambda _toy, _operand: Return(5)))
    toy.do("after the end")
    assert toy.run().done == ["a", "b"]


def test_a_run_may_start_and_end_within_the_steps_of_a_routine() -> None:
    toy = Toy()
    for name in "abcde":
        toy.do(name)
    code = toy.compiler.finish()
    toy.flow.run(code, 3)
    assert toy.done == ["d", "e"]
    toy.flow.run(code, 1, range(1, 3))
    assert toy.done == ["d", "e", "b", "c"]
    toy.flow.run(code, 1, range(0))
    assert toy.done == ["d", "e", "b", "c"]
