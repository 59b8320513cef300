"""An effect that the motions do not contain is a loss: no other machine may run the program."""

import pytest

from camgen.lang.programs import RunRequest, find_language
from tests.support.old_programs import PACSCRIPT, RAPID, VPLUS


def list_losses(language: str, text: str) -> list[tuple[str, str]]:
    """The losses of a program, each with the text of its line."""
    lines = text.split("\n")
    executed = find_language(language).run({"a": text}, RunRequest())
    return [(lines[line - 1].strip(), what) for line, what in executed.lost]


@pytest.mark.parametrize(
    ("language", "text", "old", "new", "expected"),
    [
        (
            "rapid",
            RAPID,
            "    Set doGun;\n",
            "    elsewhere;\n",
            "elsewhere is in none of the files: it is left out",
        ),
        ("rapid", RAPID, "    Set doGun;\n", "    ActUnit STN1;\n", None),
        (
            "rapid",
            RAPID,
            "    Set doGun;\n",
            "    CONNECT intStop WITH trStop;\n",
            "the trap trstop is in none of the files: it is left out",
        ),
        (
            "rapid",
            RAPID,
            "[0,0,0,0],[9E9,",
            "[0,0,0,0],[100,",
            "external axes: have values in the targets; they are not shown",
        ),
        (
            "vplus",
            VPLUS,
            "        SIGNAL 5\n",
            "        CALL other\n",
            "program other is not in these files: left out",
        ),
        ("vplus", VPLUS, "        SIGNAL 5\n", "        TYPE 5\n", None),
        (
            "pacscript",
            PACSCRIPT,
            "    Next i\n",
            "        Call Other\n    Next i\n",
            "other is in no file that is given: left out, with all that it moves and sets",
        ),
        ("pacscript", PACSCRIPT, "    Next i\n", "        PrintDbg i\n    Next i\n", None),
    ],
)
def test_an_effect_that_is_missing_in_the_motions_is_a_loss(language, text, old, new, expected):
    assert list_losses(language, text) == []
    assert old in text
    losses = list_losses(language, text.replace(old, new))
    assert [what.lower() for _, what in losses] == ([] if expected is None else [expected])
    if expected is not None and "external" not in expected:
        assert losses[0][0] == new.strip().split("\n")[0].strip()
