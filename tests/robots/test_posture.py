"""What controllers call a posture, from the joints to each text and back."""

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


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction) -> Program:
    return Program(
        "part", translation(300, -75, 100), translation(0, 0, 100), (MoveJ(HOME6, 100.0), *body)
    )


def posted(name: str, plan: Program, **options: Any) -> tuple[str, Program]:
    """The text, verified, and the program that it prints."""
    post = make_post(find_post(name), options)
    prepared = post.prepare(plan, 0.01)
    files = post.render(prepared)
    reading = find_readback(name)({file.name: file.text for file in files}, options)
    compare(prepared, reading, post.tolerance(), post.list_verified(), files[0].name)
    return "".join(file.text for file in files), prepared


def named(name: str, *rows: list[float], straight: tuple[int, ...] = ()) -> list[Posture | None]:
    own = np.isin(np.arange(len(rows)), straight)
    return compute_postures(find_robot(name), np.radians(rows), own)


# -- names -----------------------------------------------------------------------------------------------------------


def test_a_posture_worked_out_by_hand() -> None:
    """IRB 120, tool ahead: axis 1 at -10 is in quarter -1, 4 at 100 in 1, 6 at 200 in 2; axis 5 below 0 counts 1. The
    forearm points ahead, not behind the upper arm.
    """
    (found,) = named("IRB 120", [-10, 20, 10, 100, -30, 200])
    assert found == Posture((-1, 1, 2, 1), 1 + 8, ("LEFTY", "ABOVE", "FLIP", "MULTIPLE"))


def test_what_is_not_sure_is_left_out() -> None:
    """An arm with a rod that reaches over itself has no cfx; one with its back to the work no figure and no words."""
    back = [0, -95, -100, 0, 30, 0]
    assert named("IRB 2400", back) == [None]
    (turned,) = named("IRB 120", [0, -90, -60, 0, 30, 0])
    assert turned is not None
    assert (turned.figure, turned.switches) == (None, ())
    assert turned.confdata is not None
    assert turned.confdata[3] & 4


def test_switches_are_known_for_all_or_for_none() -> None:
    ahead, back = [0, 20, 10, 0, 30, 0], [0, -90, -60, 0, 30, 0]
    alone, both = named("IRB 120", ahead), named("IRB 120", ahead, back)
    assert alone[0] is not None
    assert both[0] is not None
    assert (alone[0].switches, both[0].switches) == (FRONT, ())


def test_scara_and_iterated_arms() -> None:
    cobra = np.array([[0.0, 0.5, 10.0, 0.0], [0.0, -0.5, 10.0, 3.5]])
    found = compute_postures(find_robot("Cobra s600"), cobra, np.zeros(2, bool))
    assert found == [
        Posture(switches=("RIGHTY", "SINGLE")),
        Posture(switches=("LEFTY", "MULTIPLE")),
    ]
    assert named("COBOTTA", np.degrees(find_robot("COBOTTA").home).tolist()) == [None]
    assert compute_postures(find_robot("mill"), np.zeros((1, 3)), np.zeros(1, bool)) == [None]


def test_a_line_that_takes_axis_6_past_half_a_turn_has_no_figure() -> None:
    rows = [[0.0, 20, 10, 0, 30, turn] for turn in (170, 190, 195, 170, 180)]
    lines = [one and one.figure for one in named("VS-060", *rows, straight=(1, 2, 3, 4))]
    joint = [one and one.figure for one in named("VS-060", *rows)]
    assert lines == [5, None, 13, None, None]
    assert joint == [5, 13, 13, 5, None]


def test_alike_rows_share_a_posture() -> None:
    found = named("IRB 120", *([[0.0, 20, 10, 0, 30, turn] for turn in (10, 20, 100, 110, 30)]))
    assert found[0] is found[1] is found[4]
    assert found[2] is found[3] is not found[0]


# -- texts -----------------------------------------------------------------------------------------------------------

WAY = (
    Comment("path c1"),
    MoveJ(at(0, 0, 20), 100.0, posture=Posture((0, 0, -1, 0), 5, FRONT)),
    MoveL(at(0, 0), 20.0, posture=Posture((0, 0, -1, 0), 5, FRONT)),
    MoveL(at(9, 0), 20.0, posture=Posture(None, None, FRONT)),
    MoveJ(Joints((0.1, 0.2, 0.3, 0.4, -0.5, 0.6)), 100.0),
    MoveL(at(30, 0), 20.0, posture=Posture((0, 0, 1, 1), 1, FLIPPED)),
    MoveC(at(35, 2), at(40, 0), 20.0, posture=Posture((0, 0, 1, 1), 1, FLIPPED)),
    MoveJ(HOME6, 100.0),
)


def test_pacscript_states_the_figure_where_it_is_sure() -> None:
    text = posted("pacscript", program(*WAY))[0]
    found = [line for line in text.splitlines() if " P(" in line and "Move" in line]
    assert [line.count(", 5)") for line in found] == [1, 1, 0, 0, 0]
    assert [line.count(", -1)") for line in found] == [0, 0, 1, 0, 0]
    assert [line.count(", 1)") for line in found] == [0, 0, 0, 1, 2]
    assert "' posture: fixed by the first joint move, then by Fig; -1: as it is\n" in text


def test_rapid_supervises_only_what_it_states() -> None:
    text = posted("rapid", program(*WAY))[0]
    assert "ConfJ\\On;" in text
    assert "ConfL\\Off;" in text
    assert [text.count(f"[{conf}]") for conf in ("0,0,-1,0", "0,0,0,0", "0,0,1,1")] == [2, 1, 3]


def test_vplus_switches_when_they_change() -> None:
    """V+ gets lines: an arc would become some before its posture is known."""
    text, _ = posted("vplus", program(*(item for item in WAY if not isinstance(item, MoveC))))
    words = [line.split()[0] for line in text.splitlines() if line.strip()]
    words = [word for word in words if word in {*FRONT, *FLIPPED, "MOVE", "MOVES"}]
    assert words == ["MOVE", *FRONT, "MOVE", "MOVES", "MOVES", "MOVE", *FLIPPED, "MOVES", "MOVE"]


def test_each_part_of_a_long_vplus_program_states_its_posture() -> None:
    way = [MoveL(at(k, k % 2), 20.0, posture=Posture(switches=FRONT)) for k in range(30)]
    text, _ = posted("vplus", program(replace(way[0], target=at(0, 0, 9)), *way), max_lines=20)
    parts = text.split(".PROGRAM ")[2:]
    assert len(parts) > 2
    for part in parts:
        before = part[: part.index(":TRANS")]
        assert [line.strip() for line in before.splitlines() if line.strip() in FRONT] == list(
            FRONT
        )


def test_words_of_an_option_and_of_a_plan_are_not_mixed() -> None:
    with pytest.raises(JobError, match=r"cell\.robot plans the posture"):
        posted("vplus", program(*WAY), posture=["RIGHTY"])
    unsure = program(
        *(
            replace(item, posture=None) if isinstance(item, (MoveJ, MoveL)) else item
            for item in WAY[:4]
        )
    )
    assert posted("vplus", unsure, posture=["RIGHTY"])[0].count("RIGHTY") == 1


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
    (was, says), message = TAMPERED[name]
    (file,) = result.files
    assert was in file.text
    for text in (file.text.replace(was, says, 1), file.text.replace(was, says)):
        reading = find_readback(name)({file.name: text}, {})
        assert all(one.level == "unusual" for one in reading.findings)
        with pytest.raises(VerifyError, match=rf"{message}|from figure 1 to 5 along a line"):
            compare(
                result.program,
                reading,
                result.post.tolerance(),
                result.post.list_verified(),
                file.name,
            )


@pytest.mark.parametrize("name", ARMS)
def test_a_posture_that_nobody_planned_is_refused(name: str) -> None:
    """What a text adds to a program without a robot."""
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
    """With the tool straight down axis 1 of an IRB 120 or VS-060 points at the TCP, and axis 6 makes up for it, from
    half a turn on. The work frame is 25 mm to the right of the middle: left of it axis 1 is in quarter 0 and axis 6 in
    2, double; right of it in -1 and 1, single. Figures are as there, or open.
    """
    folder = PARTS.parent / "cases" / "bracket-robot" / "expected"
    number = r"(-?[0-9.]+)"
    text = (folder / "part.mod").read_text()
    # Of an arc the end counts, whose line begins with its point.
    ends = re.findall(
        rf"(?:Move[LJ] |^ +)\[\[{number},{number},{number}\],\S*?\],\[(-?\d,-?\d,-?\d,-?\d)\]",
        text,
        re.M,
    )
    assert {conf for *_, conf in ends} == {"-1,0,1,0", "0,0,2,0"}
    for _, y, _, conf in ends:
        assert conf == ("0,0,2,0" if float(y) > 25 else "-1,0,1,0")
    text = (folder / "part.pcs").read_text()
    places = re.findall(
        rf"P\({number}, {number}, {number}, 180.0000, 0.0000, 0.0000, (-?\d+)\), Speed", text
    )
    assert {figure for *_, figure in places} == {"5", "13", "-1"}
    for _, y, _, figure in places:
        assert figure in ("-1", "13" if float(y) > 25 else "5")


def test_points_of_an_arc_with_two_figures_are_a_fault() -> None:
    text, _ = posted("pacscript", program(*WAY))
    (line,) = (line for line in text.splitlines() if "Move C" in line)
    other = text.replace(line, line.replace(", 1)", ", 5)", 1))
    faults = find_readback("pacscript")({"part.pcs": other}, {}).findings
    assert [fault.what for fault in faults] == ["the points of the arc have different figures"]


# -- the whole walk --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_the_plan_file_holds_the_posture(
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
    (was, says), _ = TAMPERED[name]
    data = text.read_bytes().decode().replace("\r\n", "\n")
    text.write_text(data.replace(was, says))
    assert main(check) == 4


def test_the_summary_says_where_the_text_is_silent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["build", str(PARTS / "bracket.dxf"), "-o", str(tmp_path), "--set", "cell.robot=VS-060"]
    assert main([*words, "--post", "rapid", "--set", "post.conf=off"]) == 0
    assert "in a posture that the text does not state (" in capsys.readouterr().err
    across = ["--set", "cell.base_from_work=[320,-25,150,0,0,0]"]
    assert main([*words, "--post", "pacscript", *across]) == 0
    assert "in a posture that the text states at " in capsys.readouterr().err
