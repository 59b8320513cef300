"""What a program does and its motions do not say: told by a field, so that no other machine runs what is left."""

import pytest

from camgen.lang.programs import RunRequest, find_language
from tests.support.old_programs import PACSCRIPT, RAPID, VPLUS


def lost(language: str, text: str) -> list[tuple[str, str]]:
    """What is lost, each with the text of its line."""
    lines = text.split("\n")
    executed = find_language(language).run({"a": text}, RunRequest())
    return [(lines[line - 1].strip(), what) for line, what in executed.lost]


@pytest.mark.parametrize(
    ("language", "text", "old", "new", "said"),
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
def test_what_is_missing_in_the_motions_is_told_by_a_field(language, text, old, new, said):
    assert lost(language, text) == []
    assert old in text
    found = lost(language, text.replace(old, new))
    assert [what.lower() for _, what in found] == ([] if said is None else [said])
    if said is not None and "external" not in said:
        assert found[0][0] == new.strip().split("\n")[0].strip()
