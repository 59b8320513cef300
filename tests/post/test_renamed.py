"""Inputs with the name of a word of the controller: they get another name and a note."""

import shutil
from pathlib import Path

import pytest

import camgen
from camgen.lang.rapid.instructions import EFFECTS
from camgen.lang.rapid.motions import FORMS
from camgen.lang.rapid.types import INSTALLED
from camgen.lang.vplus.flow import DOES
from camgen.lang.vplus.names import TAKEN
from postprocessors.rapid.options import is_predefined, legal_name
from postprocessors.vplus.rules import is_word, program_name

PART = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"


def build(folder: Path, post: str, name: str) -> camgen.Result:
    """A build of a part whose file is called `name`."""
    file = folder / f"{name}.dxf"
    shutil.copy(PART, file)
    return camgen.build(file, post=post, job={"operation": {"kind": "trace"}})


@pytest.mark.parametrize(
    ("post", "name", "line"),
    [
        ("rapid", "cirpathmode", "MODULE mcirpathmode"),
        ("vplus", "abort", ".PROGRAM p_abort()"),
        ("pacscript", "takearm", "Sub Main"),
    ],
)
def test_a_name_of_the_controller_is_replaced(tmp_path: Path, post: str, name: str, line: str):
    result = build(tmp_path, post, name)
    lines = result.files[0].text.splitlines()
    assert line in lines
    notes = [note.what for note in result.notes if note.what.endswith(f", not {name}")]
    assert len(notes) == 1
    renamed = line.removeprefix("MODULE ").removeprefix(".PROGRAM ").removesuffix("()")
    assert post == "pacscript" or f" {renamed}," in notes[0]
    if post == "pacscript":
        assert result.files[0].name == "job_takearm.pcs"


def test_another_name_stays(tmp_path: Path) -> None:
    result = build(tmp_path, "rapid", "bracket")
    assert not [note for note in result.notes if "is called" in note.what]


@pytest.mark.parametrize("name", ["Abs", "WaitRob", "err_frame", "listitem", "if", "v100", "reg1"])
def test_a_predefined_name_of_rapid_gets_a_prefix(name: str) -> None:
    assert is_predefined(name)
    assert legal_name(name, 32) == f"m{name}"


@pytest.mark.parametrize("name", ["latch", "Window", "pos", "duration", "wait.event"])
def test_a_word_of_vplus_gets_a_prefix(name: str) -> None:
    assert program_name(name, 0, ()) == f"p_{name.lower()}"


def test_the_lists_of_the_posts_have_all_words_of_the_readers() -> None:
    """The posts do not import the readers."""
    names = INSTALLED | EFFECTS.keys() | FORMS.keys()
    assert [name for name in names if not is_predefined(name)] == []
    words = {word for word in DOES.keys() | TAKEN if word[:1].isalpha()}
    assert [word for word in words if not is_word(word)] == []
