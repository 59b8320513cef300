"""No text makes the interpreter of PacScript raise an error or take long."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.read.productions import read_forms
from camgen.lang.pacscript.language import LANGUAGE
from camgen.lang.programs import Executed, RunRequest
from camgen.model.limits import Limits
from tests.lang.pacscript.test_run import MAIN, NAMES, OTHER, PAC
from tests.support.examples import fewer, is_night
from tests.support.steps import CALLS_OF_A_STEP, assert_linear, count_calls

_WORDS = """
    Sub Main End If Then Else For i = 1 To 3 Step Next Do While Loop Until Select Case Move P ,
    @P L C ( ) [ ] P1 IO [24] Set Reset Wait Delay 5 " & _ : ' * label GoTo Call Dim As Integer
    #Define #If #EndIf #Include + - / ^ Mod . 1e9
"""
WORDS = st.sampled_from([*_WORDS.split(), "\n"])


#: Statements that a loop may run in these tests: enough to be far above the lines of a text.
STEPS = 20_000
DEFAULT = Limits()


def run(text: str, limits: Limits = DEFAULT) -> Executed:
    executed = LANGUAGE.run({"part.pcs": text}, RunRequest(limits=limits))
    LANGUAGE.recognise(text)
    assert len(executed.body) == len(executed.lines)
    assert len(executed.frame) in (0, len(executed.body))
    assert list(executed.findings) == sorted(executed.findings, key=lambda finding: finding.line)
    return executed


@fewer(12)
@given(st.text(max_size=300))
def test_any_text_is_run(text: str) -> None:
    run(text)


@given(st.lists(WORDS, max_size=60))
def test_words_in_any_order_are_run(words: list[str]) -> None:
    run("Sub Main\nTakeArm\n" + " ".join(words) + "\nEnd Sub\n")


@given(st.binary(max_size=200))
def test_any_bytes_are_run(data: bytes) -> None:
    run(data.decode("latin-1"))


@given(st.binary(max_size=200))
def test_any_bytes_are_read_as_a_file_of_points(data: bytes) -> None:
    points = {"P_Var.csv": data.decode("latin-1")}
    LANGUAGE.run(
        {"a.pcs": "Sub Main\nTakeArm\nMove P, P[1]\nMove P, J[1]\nEnd Sub\n"},
        RunRequest(points=points),
    )


ACCEPTED = [
    form.text for form in read_forms("pacscript") if form.taken and form.production != "procedures"
]
ACCEPTED_TEXT = (
    "Sub Main\nTakeArm\n" + "\n".join(text for text in ACCEPTED if "#" not in text) + "\nEnd Sub\n"
)


@pytest.mark.parametrize(
    "text", [ACCEPTED_TEXT, PAC, MAIN + NAMES + OTHER], ids=["whole", "pac", "files"]
)
def test_a_program_with_lines_deleted_doubled_and_damaged_is_run(text: str) -> None:
    lines = text.split("\n")
    rng = random.Random(7)
    for _ in range(150 if is_night() else 60):
        damaged = list(lines)
        for _ in range(rng.randint(1, 6)):
            index = rng.randrange(len(damaged))
            change = rng.randrange(3)
            if change == 0 and len(damaged) > 1:
                del damaged[index]
            elif change == 1:
                damaged.insert(index, damaged[rng.randrange(len(damaged))])
            else:
                cut = rng.randint(0, len(damaged[index]))
                damaged[index] = (
                    damaged[index][:cut]
                    + rng.choice("()[],\"'=@_:.&*-\x00")
                    + damaged[index][cut + rng.randint(0, 2) :]
                )
        run("\n".join(damaged))


LONG_TEXTS: dict[str, Callable[[int], str]] = {
    "faulty": lambda count: "Moove (L, +* ]\n" * count,
    "open blocks": lambda count: "If a Then\n" * count,
    "labels": lambda count: (
        "".join(f"l{k}: GoTo l{k + 1}\n" for k in range(count)) + f"l{count}:\n"
    ),
    "procedures": lambda count: "".join(f"Call a{k}\nEnd Sub\nSub a{k}\n" for k in range(1, count)),
    "macros": lambda count: "".join(f"#Define A{k} A{k + 1}\n" for k in range(count)) + "x = A0\n",
    "a long line": lambda count: "x = " + "1 + " * count + "1\n",
    "a statement of many lines": lambda count: "x = 1 + _\n" * count + "\n",
    "many statements of a line": lambda count: "x=1:" * count + "\n",
    "brackets": lambda count: "x = " + "(" * count + "\n",
    "outputs": lambda count: "TakeArm\n" + "Move P, @P P(1, 2, 3)\nSet IO[1]\n" * count,
}


@pytest.mark.parametrize("name", LONG_TEXTS)
def test_each_line_of_a_long_text_costs_the_same(name: str) -> None:
    assert_linear(lambda count: run(f"Sub Main\n{LONG_TEXTS[name](count)}End Sub\n"), 4000)


@pytest.mark.parametrize(
    "loops",
    [
        "For i = 1 To 1000000\n" * 3 + "x = x + 1\n" + "Next\n" * 3,
        's = "a"\nFor i = 1 To 1000\ns = s & s\nNext\n',
    ],
)
def test_loops_end_at_the_limit_of_steps(loops: str) -> None:
    limits = Limits(pacscript_steps=STEPS)
    calls = count_calls(lambda: run(f"Sub Main\n{loops}End Sub\n", limits))
    assert calls < CALLS_OF_A_STEP * STEPS


def test_each_line_of_a_long_program_costs_the_same() -> None:
    def execute(count: int) -> None:
        lines = [
            f"    ppp = P( {k * 0.01:.2f}, {k % 9}, 400, 180, 0, {k % 180}, -1 )\n"
            f"    Move L, @P Dev(ppp, P({k % 5}, 2, 3)), S = 20 ' go\n"
            f"    If IO[{k % 100}] = On Then\n        Delay 100\n    End If\n"
            f"    Set IO[{k % 20 + 100}]\n"
            for k in range(count)
        ]
        head = "Sub Main\n    TakeArm\n    Dim ppp As Position\n"
        executed = run(head + "".join(lines) + "End Sub\n")
        assert sum(type(item).__name__ == "MoveL" for item in executed.body) == count

    assert_linear(execute, 1000)
