"""Whatever stands in a text, the run of it ends soon and says what is wrong; nothing is raised."""

import random
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.read.productions import read_forms
from camgen.read.pacscript.language import LANGUAGE
from camgen.read.programs import Ask, Executed
from tests.read.pacscript.test_run import MAIN, NAMES, OTHER, PAC

_WORDS = """
    Sub Main End If Then Else For i = 1 To 3 Step Next Do While Loop Until Select Case Move P , @P L C ( ) [ ] P1 IO
    [24] Set Reset Wait Delay 5 " & _ : ' * label GoTo Call Dim As Integer #Define #If #EndIf #Include + - / ^ Mod .
    1e9"""
WORDS = st.sampled_from([*_WORDS.split(), "\n"])


def run(text: str) -> Executed:
    found = LANGUAGE.run({"part.pcs": text}, Ask())
    LANGUAGE.recognise(text)
    assert len(found.body) == len(found.lines)
    assert len(found.frame) in (0, len(found.body))
    assert list(found.findings) == sorted(found.findings, key=lambda one: one.line)
    return found


@given(st.text(max_size=300))
def test_any_text(text: str) -> None:
    run(text)


@given(st.lists(WORDS, max_size=60))
def test_words_in_any_order(words: list[str]) -> None:
    run("Sub Main\nTakeArm\n" + " ".join(words) + "\nEnd Sub\n")


@given(st.binary(max_size=200))
def test_bytes(data: bytes) -> None:
    run(data.decode("latin-1"))


@given(st.binary(max_size=200))
def test_files_of_points(data: bytes) -> None:
    points = {"P_Var.csv": data.decode("latin-1")}
    LANGUAGE.run(
        {"a.pcs": "Sub Main\nTakeArm\nMove P, P[1]\nMove P, J[1]\nEnd Sub\n"}, Ask(points=points)
    )


ACCEPTED = [
    form.text for form in read_forms("pacscript") if form.taken and form.production != "procedures"
]
WHOLE = (
    "Sub Main\nTakeArm\n" + "\n".join(text for text in ACCEPTED if "#" not in text) + "\nEnd Sub\n"
)


@pytest.mark.parametrize("text", [WHOLE, PAC, MAIN + NAMES + OTHER], ids=["whole", "pac", "files"])
def test_lines_left_out_doubled_and_damaged(text: str) -> None:
    lines = text.split("\n")
    rng = random.Random(7)
    for _ in range(150):
        some = list(lines)
        for _ in range(rng.randint(1, 6)):
            at = rng.randrange(len(some))
            kind = rng.randrange(3)
            if kind == 0 and len(some) > 1:
                del some[at]
            elif kind == 1:
                some.insert(at, some[rng.randrange(len(some))])
            else:
                cut = rng.randint(0, len(some[at]))
                some[at] = (
                    some[at][:cut]
                    + rng.choice("()[],\"'=@_:.&*-\x00")
                    + some[at][cut + rng.randint(0, 2) :]
                )
        run("\n".join(some))


LONG = {
    "faulty": "Sub Main\n" + "Moove (L, +* ]\n" * 20_000 + "End Sub\n",
    "open blocks": "Sub Main\n" + "If a Then\n" * 20_000 + "End Sub\n",
    "labels": "Sub Main\n"
    + "".join(f"l{k}: GoTo l{k + 1}\n" for k in range(20_000))
    + "l20000:\nEnd Sub\n",
    "procedures": "".join(f"Sub a{k}\nCall a{k + 1}\nEnd Sub\n" for k in range(10_000))
    + "Sub Main\nCall a0\nEnd Sub\n",
    "macros": "".join(f"#Define A{k} A{k + 1}\n" for k in range(20_000))
    + "Sub Main\nx = A0\nEnd Sub\n",
    "a long line": "Sub Main\nx = " + "1 + " * 100_000 + "1\nEnd Sub\n",
    "a statement of many lines": "Sub Main\n" + "x = 1 + _\n" * 50_000 + "\nEnd Sub\n",
    "many statements of a line": "Sub Main\n" + "x=1:" * 50_000 + "\nEnd Sub\n",
    "brackets": "Sub Main\nx = " + "(" * 100_000 + "\nEnd Sub\n",
    "outputs": "Sub Main\nTakeArm\n" + "Move P, @P P(1, 2, 3)\nSet IO[1]\n" * 20_000 + "End Sub\n",
    "loops": "Sub Main\n"
    + "For i = 1 To 1000000\n" * 3
    + "x = x + 1\n"
    + "Next\n" * 3
    + "End Sub\n",
    "texts": 'Sub Main\ns = "a"\nFor i = 1 To 1000\ns = s & s\nNext\nEnd Sub\n',
}


@pytest.mark.parametrize("name", LONG)
def test_long_texts_take_seconds(name: str) -> None:
    began = time.process_time()
    run(LONG[name])
    assert time.process_time() - began < 10


def test_a_megabyte_is_run_in_seconds() -> None:
    lines = [
        f"    ppp = P( {k * 0.01:.2f}, {k % 9}, 400, 180, 0, {k % 180}, -1 )\n"
        f"    Move L, @P Dev(ppp, P({k % 5}, 2, 3)), S = 20 ' go\n"
        f"    If IO[{k % 100}] = On Then\n        Delay 100\n    End If\n    Set IO[{k % 20 + 100}]\n"
        for k in range(6000)
    ]
    text = "Sub Main\n    TakeArm\n    Dim ppp As Position\n" + "".join(lines) + "End Sub\n"
    assert len(text) > 900_000
    began = time.process_time()
    found = run(text)
    assert sum(type(item).__name__ == "MoveL" for item in found.body) == 6000
    assert time.process_time() - began < 10
