"""Robot programs posted for another controller and back: the same motion (docs/translate.md)."""

from itertools import permutations
from pathlib import Path

import pytest

import camgen
from bench.read.goldens import CASES, POSTS, measure_apart
from bench.read.translate import WITHIN, find_difference, measure_rapids, translate_twice
from camgen.model.errors import InputError
from camgen.model.program import MoveC, Output
from tests.support.old_programs import PACSCRIPT, RAPID


@pytest.mark.parametrize("case", ["bracket-robot", "layers-inside", "space-trace"])
@pytest.mark.parametrize(("source", "target"), list(permutations(POSTS, 2)))
def test_a_translation_and_back_has_the_same_motion(case: str, source: str, target: str) -> None:
    file = CASES / case / "expected" / f"part{POSTS[source][0]}"
    if not file.exists():
        pytest.skip(f"{case} has no program for {source}")
    before, after = translate_twice(CASES / case, source, target)
    assert len(before.points) > 100
    assert measure_apart(before.points, after.points) < WITHIN
    assert before.seconds == pytest.approx(after.seconds, rel=2e-3, abs=2e-3)
    assert before.outputs == after.outputs


@pytest.mark.parametrize("case", ["layers-inside", "plate-drill"])
@pytest.mark.parametrize(
    ("source", "target"),
    [*permutations(["rapid", "gcode"]), *permutations(["gcode", "grbl"]),
     ("vplus", "gcode"), ("gcode", "pacscript")],
)  # fmt: skip
def test_a_translation_through_gcode_has_the_same_motion(
    case: str, source: str, target: str
) -> None:
    """Rapid motions become lines and joint motions become rapid motions, with the same targets."""
    before, after = translate_twice(CASES / case, source, target)
    assert len(before.points) > 100
    assert measure_apart(before.points, after.points) < WITHIN
    assert before.seconds == pytest.approx(after.seconds, rel=2e-3, abs=2e-3)
    assert measure_rapids(before, after) < 0.002
    assert find_difference(before, after) in (
        "",
        "the spindle is on or off" if target == "pacscript" else "",
    )


@pytest.mark.parametrize(
    ("case", "source", "message"),
    [
        ("space-trace", "rapid", "the tool is not straight down, and the machine has three axes"),
        ("bracket-deburr", "pacscript", "G-code has no force control"),
    ],
)
def test_a_feature_that_a_mill_lacks_is_refused_by_name(
    case: str, source: str, message: str
) -> None:
    with pytest.raises(camgen.CamgenError, match=message):
        translate_twice(CASES / case, source, "gcode")


def test_outputs_of_an_old_program_may_have_other_names(tmp_path: Path) -> None:
    """An analog output of a robot is the spindle of a mill."""
    file = tmp_path / "old.mod"
    file.write_bytes((CASES / "plate-drill" / "expected" / "part.mod").read_bytes())
    with pytest.raises(camgen.CamgenError, match=r'input\.signals = \{ aoSpindle = "spindle" \}'):
        camgen.build(file, post="gcode", job={"post": {"signals": {"aoSpindle": "P0"}}})
    job = {"input": {"signals": {"aoSpindle": "spindle"}}}
    assert "S2500 M3" in camgen.build(file, post="gcode", job=job).text
    with pytest.raises(
        InputError, match=r"switches no output 'aoOther' \(input\.signals\); it switches aoSpindle"
    ):
        camgen.build(file, post="gcode", job={"input": {"signals": {"aoOther": "spindle"}}})


def split_modules(tmp_path: Path) -> list[Path]:
    """The program in two modules: its routines, and its data."""
    head, _, rest = RAPID.partition("  PERS tooldata")
    declarations, _, routines = rest.partition("\n\n")
    (tmp_path / "glue.mod").write_text(f"{head}{routines}")
    (tmp_path / "data.mod").write_text(f"MODULE Data\n  PERS tooldata{declarations}\nENDMODULE\n")
    return [tmp_path / "glue.mod", tmp_path / "data.mod"]


def test_several_modules_are_one_program(tmp_path: Path) -> None:
    job = {"post": {"signals": {"doGun": 24}}}
    result = camgen.build(split_modules(tmp_path), post="pacscript", job=job)
    assert result.part.source == "glue.mod + data.mod"
    (tmp_path / "whole.mod").write_text(RAPID)
    single = camgen.build(tmp_path / "whole.mod", post="pacscript", job=job)
    assert [type(instruction) for instruction in result.program.body] == [
        type(instruction) for instruction in single.program.body
    ]
    # Three beads, each with an arc at its end and the output on and off.
    assert sum(isinstance(instruction, MoveC) for instruction in result.program.body) == 3
    assert [
        instruction.value for instruction in result.program.body if isinstance(instruction, Output)
    ] == [
        0,
        1,
        0,
        1,
        0,
        1,
        0,
    ]


def test_a_module_without_its_data_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"glue\.mod: holds no motion"):
        camgen.build(split_modules(tmp_path)[0], post="pacscript")


def test_a_program_without_a_tool_moves_the_flange(tmp_path: Path) -> None:
    (tmp_path / "nut.pcs").write_text(PACSCRIPT)
    result = camgen.build(
        tmp_path / "nut.pcs", post="rapid", job={"post": {"signals": {"24": "doNut"}}}
    )
    assert result.program.flange_from_tool.origin == (0, 0, 0)
    assert result.reach is not None
    assert result.reach.robot == "IRB 120"
    assert "[[0.000,0.000,0.000],[1.0000000,0.0000000,0.0000000,0.0000000]]" in result.text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("    Set doGun;\n", "    MoveL pNowhere,v100,fine,tGun;\n    Set doGun;\n", r"left out"),
        ("    Set doGun;\n", "    elsewhere;\n    Set doGun;\n", r"elsewhere.*left out"),
        ("[0,0,0,0],[9E9,", "[0,0,0,0],[100,", r"external axes"),
    ],
)
def test_a_statement_that_cannot_be_translated_refuses_the_program(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    """Without a motion, the next motion would run on another path."""
    assert old in RAPID
    (tmp_path / "glue.mod").write_text(RAPID.replace(old, new))
    with pytest.raises(InputError, match=message):
        camgen.build(
            tmp_path / "glue.mod", post="pacscript", job={"post": {"signals": {"doGun": 24}}}
        )


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "    Set doGun;\n",
            "    MoveExtJ [[9E9,9E9,9E9,9E9,9E9,9E9],[50,9E9,9E9,9E9,9E9,9E9]],vmax,fine;\n"
            "    Set doGun;\n",
        ),
        ("    Set doGun;\n", "    IndAMove Station_A,1\\ToAbsNum:=90,20;\n    Set doGun;\n"),
    ],
)
def test_external_axes_of_rapid_refuse_the_program(old: str, new: str, tmp_path: Path) -> None:
    (tmp_path / "glue.mod").write_text(RAPID.replace(old, new))
    with pytest.raises(InputError, match=r"external axes"):
        camgen.build(
            tmp_path / "glue.mod", post="pacscript", job={"post": {"signals": {"doGun": 24}}}
        )


def test_extended_axes_of_pacscript_refuse_the_program(tmp_path: Path) -> None:
    move = next(line for line in PACSCRIPT.splitlines() if line.strip().startswith("Move L"))
    (tmp_path / "nut.pcs").write_text(PACSCRIPT.replace(move, f"{move} Ex((7, 10))"))
    with pytest.raises(InputError, match=r"axes"):
        camgen.build(tmp_path / "nut.pcs", post="rapid", job={"post": {"signals": {"24": "doNut"}}})
