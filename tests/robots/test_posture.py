"""Postures in the notation of each controller: from joint values to a text and back."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.cli import main
from camgen.model.errors import JobError, VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import Comment, Instruction, Joints, MoveC, MoveJ, MoveL, Posture, Program
from camgen.post.plugins import find_post, find_readback, make_post
from camgen.post.verify import compare
from camgen.robots.catalogue import find_robot
from camgen.robots.posture import compute_postures

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARMS = {"rapid": "IRB 120", "pacscript": "VS-060", "vplus": "Cobra s600"}
HOME6 = Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0))
FRONT, FLIPPED = ("LEFTY", "ABOVE", "NOFLIP", "SINGLE"), ("LEFTY", "ABOVE", "FLIP", "SINGLE")


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def make_program(*body: Instruction) -> Program:
    return Program(
        "part", translation(300, -75, 100), translation(0, 0, 100), (MoveJ(HOME6, 100.0), *body)
    )


def post_program(name: str, plan: Program, **options: Any) -> tuple[str, Program]:
    """Print a program and verify the text; return the text and the prepared program."""
    post = make_post(find_post(name), options)
    prepared = post.prepare(plan, 0.01)
    files = post.render(prepared)
    reading = find_readback(name)({file.name: file.text for file in files}, options)
    compare(prepared, reading, post.tolerance(), post.list_verified(), files[0].name)
    return "".join(file.text for file in files), prepared


def compute_arm_postures(
    name: str, *rows: list[float], straight: tuple[int, ...] = ()
) -> list[Posture | None]:
    """Postures of an arm at `rows`, deg; the motions to the rows `straight` are lines."""
    is_straight = np.isin(np.arange(len(rows)), straight)
    return compute_postures(find_robot(name), np.radians(rows), is_straight)


# Names.


def test_a_posture_agrees_with_one_worked_out_by_hand() -> None:
    """The tool of the IRB 120 is ahead.

    Axis 1 at -10 deg is in quarter -1, axis 4 at 100 deg in 1, axis 6 at 200 deg in 2. Axis 5 below
    0 counts 1. A forearm beyond the line of the upper arm would count 2, but it points ahead.
    """
    (posture,) = compute_arm_postures("IRB 120", [-10, 20, 10, 100, -30, 200])
    assert posture == Posture((-1, 1, 2, 1), 1 + 8, ("LEFTY", "ABOVE", "FLIP", "MULTIPLE"))


def test_a_notation_that_is_unsure_is_left_out() -> None:
    """An arm with a parallel rod has no cfx if it reaches over itself.

    An arm that is bent backwards over axis 1 has no figure and no switches.
    """
    overhead = [0, -95, -100, 0, 30, 0]
    assert compute_arm_postures("IRB 2400", overhead) == [None]
    (bent_back,) = compute_arm_postures("IRB 120", [0, -90, -60, 0, 30, 0])
    assert bent_back is not None
    assert (bent_back.figure, bent_back.switches) == (None, ())
    assert bent_back.confdata is not None
    assert bent_back.confdata[3] & 4


def test_switches_of_a_program_are_left_out_if_one_is_unknown() -> None:
    ahead, back = [0, 20, 10, 0, 30, 0], [0, -90, -60, 0, 30, 0]
    alone, both = (
        compute_arm_postures("IRB 120", ahead),
        compute_arm_postures("IRB 120", ahead, back),
    )
    assert alone[0] is not None
    assert both[0] is not None
    assert (alone[0].switches, both[0].switches) == (FRONT, ())


def test_a_scara_has_switches_and_an_iterated_arm_has_no_posture() -> None:
    cobra = np.array([[0.0, 0.5, 10.0, 0.0], [0.0, -0.5, 10.0, 3.5]])
    postures = compute_postures(find_robot("Cobra s600"), cobra, np.zeros(2, bool))
    assert postures == [
        Posture(switches=("RIGHTY", "SINGLE")),
        Posture(switches=("LEFTY", "MULTIPLE")),
    ]
    assert compute_arm_postures("COBOTTA", np.degrees(find_robot("COBOTTA").home).tolist()) == [
        None
    ]
    assert compute_postures(find_robot("mill"), np.zeros((1, 3)), np.zeros(1, bool)) == [None]


def test_a_line_on_which_axis_6_passes_180_deg_has_no_figure() -> None:
    rows = [[0.0, 20, 10, 0, 30, turn] for turn in (170, 190, 195, 170, 180)]
    linear = [
        posture and posture.figure
        for posture in compute_arm_postures("VS-060", *rows, straight=(1, 2, 3, 4))
    ]
    by_joints = [posture and posture.figure for posture in compute_arm_postures("VS-060", *rows)]
    assert linear == [5, None, 13, None, None]
    assert by_joints == [5, 13, 13, 5, None]


def test_rows_of_one_posture_share_one_object() -> None:
    postures = compute_arm_postures(
        "IRB 120", *([[0.0, 20, 10, 0, 30, turn] for turn in (10, 20, 100, 110, 30)])
    )
    assert postures[0] is postures[1] is postures[4]
    assert postures[2] is postures[3] is not postures[0]


# Texts.

MOTIONS = (
    Comment("path c1"),
    MoveJ(make_pose(0, 0, 20), 100.0, posture=Posture((0, 0, -1, 0), 5, FRONT)),
    MoveL(make_pose(0, 0), 20.0, posture=Posture((0, 0, -1, 0), 5, FRONT)),
    MoveL(make_pose(9, 0), 20.0, posture=Posture(None, None, FRONT)),
    MoveJ(Joints((0.1, 0.2, 0.3, 0.4, -0.5, 0.6)), 100.0),
    MoveL(make_pose(30, 0), 20.0, posture=Posture((0, 0, 1, 1), 1, FLIPPED)),
    MoveC(make_pose(35, 2), make_pose(40, 0), 20.0, posture=Posture((0, 0, 1, 1), 1, FLIPPED)),
    MoveJ(HOME6, 100.0),
)


def test_pacscript_states_a_figure_that_is_sure() -> None:
    text = post_program("pacscript", make_program(*MOTIONS))[0]
    motions = [line for line in text.splitlines() if " P(" in line and "Move" in line]
    assert [line.count(", 5)") for line in motions] == [1, 1, 0, 0, 0]
    assert [line.count(", -1)") for line in motions] == [0, 0, 1, 0, 0]
    assert [line.count(", 1)") for line in motions] == [0, 0, 0, 1, 2]
    assert "' posture: fixed by the first joint move, then by Fig; -1: as it is\n" in text


def test_rapid_monitors_the_confdata_of_joint_motions_alone() -> None:
    text = post_program("rapid", make_program(*MOTIONS))[0]
    assert "ConfJ\\On;" in text
    assert "ConfL\\Off;" in text
    assert [text.count(f"[{conf}]") for conf in ("0,0,-1,0", "0,0,0,0", "0,0,1,1")] == [2, 1, 3]


def test_vplus_states_switches_where_they_change() -> None:
    """The arc is left out: for V+ arcs become lines before postures are known."""
    text, _ = post_program(
        "vplus", make_program(*(item for item in MOTIONS if not isinstance(item, MoveC)))
    )
    words = [line.split()[0] for line in text.splitlines() if line.strip()]
    words = [word for word in words if word in {*FRONT, *FLIPPED, "MOVE", "MOVES"}]
    assert words == ["MOVE", *FRONT, "MOVE", "MOVES", "MOVES", "MOVE", *FLIPPED, "MOVES", "MOVE"]


def test_each_part_of_a_long_vplus_program_states_its_posture() -> None:
    lines = [MoveL(make_pose(k, k % 2), 20.0, posture=Posture(switches=FRONT)) for k in range(30)]
    text, _ = post_program(
        "vplus", make_program(replace(lines[0], target=make_pose(0, 0, 9)), *lines), max_lines=20
    )
    parts = text.split(".PROGRAM ")[2:]
    assert len(parts) > 2
    for part in parts:
        statements = part[: part.index(":TRANS")]
        assert [line.strip() for line in statements.splitlines() if line.strip() in FRONT] == list(
            FRONT
        )


def test_an_option_for_switches_and_planned_switches_exclude_each_other() -> None:
    with pytest.raises(JobError, match=r"cell\.robot plans the posture"):
        post_program("vplus", make_program(*MOTIONS), posture=["RIGHTY"])
    motions = [replace(motion, posture=None) for motion in MOTIONS[1:4]]
    without_postures = make_program(MOTIONS[0], *motions)
    assert post_program("vplus", without_postures, posture=["RIGHTY"])[0].count("RIGHTY") == 1


TAMPERED = {
    "rapid": (("[-1,0,", "[0,0,"), "confdata reads"),
    "pacscript": ((", 5)", ", 1)"), "figure reads 1, planned is 5"),
    "vplus": (
        ("    RIGHTY\n", "    LEFTY\n"),
        "switches reads LEFTY SINGLE, planned is RIGHTY SINGLE",
    ),
}


@pytest.mark.parametrize("name", ARMS)
def test_a_text_with_another_posture_is_refused(name: str) -> None:
    result = camgen.build(PARTS / "bracket.dxf", post=name, job={"cell": {"robot": ARMS[name]}})
    (original, altered), message = TAMPERED[name]
    (file,) = result.files
    assert original in file.text
    for text in (file.text.replace(original, altered, 1), file.text.replace(original, altered)):
        reading = find_readback(name)({file.name: text}, {})
        assert all(finding.level == "unusual" for finding in reading.findings)
        with pytest.raises(VerifyError, match=rf"{message}|from figure 1 to 5 along a line"):
            compare(
                result.program,
                reading,
                result.post.tolerance(),
                result.post.list_verified(),
                file.name,
            )


@pytest.mark.parametrize("name", ARMS)
def test_a_text_with_a_posture_that_is_not_planned_is_refused(name: str) -> None:
    """A program without a robot has no postures, so the text may not add any."""
    result = camgen.build(PARTS / "bracket.dxf", post=name)
    (file,) = result.files
    added = {
        "rapid": ("[0,0,0,0]", "[0,0,0,4]"),
        "pacscript": (", -1)", ", 0)"),
        "vplus": ("BREAK", "BREAK\nLEFTY"),
    }
    reading = find_readback(name)({file.name: file.text.replace(*added[name], 1)}, {})
    with pytest.raises(VerifyError, match=r"reads|ConfJ is off, though each of its motions states"):
        compare(
            result.program, reading, result.post.tolerance(), result.post.list_verified(), file.name
        )


def test_the_golden_programs_agree_with_the_geometry() -> None:
    """With the tool straight down axis 1 of an IRB 120 or VS-060 points at the TCP.

    Axis 6 makes up for axis 1, starting from half a turn. The work frame is 25 mm to the right of
    the middle. Left of the middle axis 1 is in quarter 0 and axis 6 in 2, double; right of it they
    are in -1 and 1, single. Figures follow the same rule or are open.
    """
    folder = PARTS.parent / "cases" / "bracket-robot" / "expected"
    number = r"(-?[0-9.]+)"
    text = (folder / "part.mod").read_text()
    # An arc has the confdata of its end, which starts a line of its own.
    ends = re.findall(
        rf"(?:Move[LJ] |^ +)\[\[{number},{number},{number}\],\S*?\],\[(-?\d,-?\d,-?\d,-?\d)\]",
        text,
        re.M,
    )
    assert {conf for *_, conf in ends} == {"-1,0,1,0", "0,0,2,0"}
    for _, y, _, conf in ends:
        assert conf == ("0,0,2,0" if float(y) > 25 else "-1,0,1,0")
    text = (folder / "part.pcs").read_text()
    points = re.findall(
        rf"P\({number}, {number}, {number}, 180.0000, 0.0000, 0.0000, (-?\d+)\), Speed", text
    )
    assert {figure for *_, figure in points} == {"5", "13", "-1"}
    for _, y, _, figure in points:
        assert figure in ("-1", "13" if float(y) > 25 else "5")


def test_an_arc_whose_points_have_two_figures_is_refused() -> None:
    text, _ = post_program("pacscript", make_program(*MOTIONS))
    (line,) = (line for line in text.splitlines() if "Move C" in line)
    other = text.replace(line, line.replace(", 1)", ", 5)", 1))
    faults = find_readback("pacscript")({"part.pcs": other}, {}).findings
    assert [fault.what for fault in faults] == ["the points of the arc have different figures"]


# Whole builds.


@pytest.mark.parametrize("name", ARMS)
def test_verify_compares_the_posture_with_the_plan_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, plan = tmp_path / "part.txt", tmp_path / "plan.json"
    words = [
        "build",
        str(PARTS / "bracket.dxf"),
        "--post",
        name,
        "--set",
        f"cell.robot={ARMS[name]}",
    ]
    assert main([*words, "-o", str(text), "--plan", str(plan)]) == 0
    assert "in the posture that the text states (" in capsys.readouterr().err
    check = ["verify", str(text), "--post", name, "--plan", str(plan)]
    assert main(check) == 0
    (original, altered), _ = TAMPERED[name]
    data = text.read_bytes().decode().replace("\r\n", "\n")
    text.write_text(data.replace(original, altered))
    assert main(check) == 4


def test_the_summary_tells_whether_the_text_states_the_posture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["build", str(PARTS / "bracket.dxf"), "-o", str(tmp_path), "--set", "cell.robot=VS-060"]
    assert main([*words, "--post", "rapid", "--set", "post.conf=off"]) == 0
    assert "in a posture that the text does not state (" in capsys.readouterr().err
    shifted = ["--set", "cell.base_from_work=[320,-25,150,0,0,0]"]
    assert main([*words, "--post", "pacscript", *shifted]) == 0
    assert "in a posture that the text states at " in capsys.readouterr().err
