"""V+: points in a data file, the run of its reader, and the read-back of both.

A run moves as planned. It moves nothing if the data belong to another program.
"""

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.vplus import VPlus
from camgen_posts.vplus.records import data_name
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.reliability.modal.reader import carry_out
from camgen.cli import main
from camgen.lang.programs import Executed
from camgen.lang.vplus.language import VPLUS
from camgen.lang.vplus.strict import read
from camgen.model.errors import CamgenError, JobError, Refused, VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import (
    Comment,
    Instruction,
    Joints,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    Wait,
)
from camgen.post.kit import Case, cases, check_case
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.support.vplus_programs import CELL, HOME6
from tests.support.whole import whole

ROOT = Path(__file__).parents[2]
FILE: dict[str, object] = {"points": "file"}


def down(x: float, y: float, z: float, turn: float = 0.0) -> Pose:
    return Pose(frozen(TOOL_DOWN @ rotation_about(2, turn)), (x, y, z))


BODY: tuple[Instruction, ...] = (
    MoveJ(CELL.home, 750),
    MoveJ(down(10, 20.5, 20), 937.5, 1.0),
    MoveL(down(10, 20.5, 0), 20),
    Output("process", 1.0),
    Wait(1.25),
    Comment("edge 1"),
    MoveL(down(-0.001, 20.5, 0, 0.5), 20, 1.0),
    MoveL(down(40, 0, 0, -1.0), 12.34567),
    Output("process", 0.0),
    MoveJ(Joints((-0.5, 1.0, 123.45678, 3.0)), 750),
)


def program(*body: Instruction, name: str = "part") -> Program:
    return Program(name, CELL.base_from_work, CELL.flange_from_tool, whole(body), ("bracket.dxf",))


def render(source: Program, **options: object) -> tuple[Program, dict[str, str]]:
    """The program as the post prepares it, and its files: the reader, then the data."""
    post = make_post(VPlus, {**FILE, **options})
    prepared = post.prepare(source, 0.01)
    return prepared, {file.name: file.text for file in post.render(prepared)}


def verify(prepared: Program, reading: Executed, **options: object) -> None:
    """Compares a reading with the program, as a build does. Raises VerifyError."""
    post = make_post(VPlus, {**FILE, **options})
    compare(prepared, reading, post.tolerance(), post.list_verified(), "part.v2")


# Texts


def test_the_page_shows_a_reader_and_its_data() -> None:
    page = (ROOT / "docs" / "posts" / "vplus.md").read_text(encoding="utf-8")
    _, files = render(program(*BODY))
    blocks = page.partition("### Points in a data file")[2].split("```\n")
    rest = files["part.v2"]
    # The page leaves out repetitions.
    for piece in blocks[1].split("...\n"):
        assert piece in rest
        rest = rest.partition(piece)[2]
    assert rest == ""
    assert blocks[3] == files["part.dat"]


def test_each_instruction_has_the_line_of_its_record() -> None:
    prepared, files = render(program(*BODY))
    reading = read(files, FILE)
    assert reading.findings == ()
    verify(prepared, reading)
    lines = "".join(files.values()).splitlines()
    kinds = {MoveL: "1", MoveJ: "234", Output: "7", Wait: "8"}
    for item, line in zip(reading.body, reading.lines, strict=True):
        assert lines[line - 1].partition(",")[0] in kinds[type(item)]


def test_a_program_with_and_without_a_data_file_reads_the_same() -> None:
    source = program(*BODY)
    _, files = render(source)
    post = make_post(VPlus, {})
    without = read({file.name: file.text for file in post.render(post.prepare(source, 0.01))}, {})
    with_file = read(files, FILE)
    assert [type(i) for i in without.body] == [type(i) for i in with_file.body]
    verify(source.with_body(without.body), with_file)


def test_a_record_may_hold_a_posture_or_six_joint_values() -> None:
    words = Posture(switches=("LEFTY", "ABOVE", "NOFLIP", "SINGLE"))
    body = (
        HOME6,
        MoveJ(down(1, 2, 3), 100, posture=words),
        MoveL(down(4, 5, 6), 20, posture=words),
    )
    prepared, files = render(program(*body))
    reading = read(files, FILE)
    assert reading.findings == ()
    verify(prepared, reading)
    _, given = render(program(HOME6, MoveJ(down(1, 2, 3), 100)), posture=["LEFTY", "FLIP"])
    assert read(given, {**FILE, "posture": ["LEFTY", "FLIP"]}).findings == ()
    assert read(given, {**FILE, "posture": ["RIGHTY"]}).findings


KIT: dict[str, object] = {
    "signals": {"process": 33, "glue": 34, "spindle": 35},
    "spindle": "on-off",
    "force": "ignore",
}


@pytest.mark.parametrize("points", ["program", "file"])
@pytest.mark.parametrize("case", cases(), ids=str)
def test_conformance(case: Case, points: str) -> None:
    lacks = {"short waits", "tilt", "large", "tool changes", "optional stops"}
    if points == "file":
        lacks.add("stops")
    # Comments, and the sign of 180 deg.
    meaningless = (r";.*", r"([,(])180\b", r"[,(](-)180\b")
    check_case(VPlus, VPLUS, case, {**KIT, "points": points}, lacks, meaningless)


@pytest.mark.parametrize(
    ("name", "file"),
    [("part", "part.dat"), ("plate_12", "plate_12.dat"), ("9", "9.dat")],
)
def test_a_data_file_has_the_name_of_its_program_if_a_disk_takes_it(name: str, file: str) -> None:
    assert data_name(name) == file


def test_names_that_a_disk_does_not_take_become_different_ones() -> None:
    names = ["bracket_left", "bracket_right", "PART", "Part", "a b", "a_b ", "ü", ""]
    files = {data_name(name) for name in names}
    assert len(files) == len(names)
    assert all(len(file) <= 12 and file.isascii() and " " not in file for file in files)
    assert all(file == file.lower() for file in files)


@pytest.mark.parametrize(
    ("options", "option"),
    [
        ({"decimals": 4}, "decimals"),
        ({"tool": "cg.sum"}, "tool"),
        ({"work": "CG.A"}, "work"),
        ({"program": "cg.n"}, "program"),
    ],
)
def test_an_option_that_a_data_file_excludes_is_refused(
    options: dict[str, object], option: str
) -> None:
    make_post(VPlus, {**options, "points": "program"})
    with pytest.raises(JobError, match=rf"\[post\] {option}"):
        make_post(VPlus, {**options, **FILE})


@pytest.mark.parametrize(
    "item",
    [MoveJ(Joints((0, 0, 8388.7, 0)), 100), MoveJ(Joints((15.0, 0, 0, 0)), 100), Wait(9e6)],
)
def test_an_instruction_that_no_record_can_hold_is_refused(item: Instruction) -> None:
    source = program(MoveJ(CELL.home, 100), item)
    make_post(VPlus, {}).prepare(source, 0.01)
    with pytest.raises(Refused, match=r"has no room in a record; set post\.points"):
        render(source)


# Runs. The simulation of the bench calculates in single precision, as the controller does.

NUMBER = st.floats(-8191, 8191)
TARGET = st.builds(down, NUMBER, NUMBER, NUMBER, st.floats(-3, 3))
MOTION = st.builds(MoveL, TARGET, st.floats(0.1, 20000))


@given(st.lists(MOTION, min_size=1, max_size=8), st.floats(-6, 6), st.floats(-8000, 8000))
def test_a_run_moves_as_planned(motions: list[MoveL], angle: float, slide: float) -> None:
    ends = [motion.target.origin for motion in motions]
    # A reorientation at a fixed TCP would have a rotational speed.
    assume(all(math.dist(a, b) > 1 for a, b in itertools.pairwise(ends)))
    prepared, files = render(program(MoveJ(Joints((angle, 0.5, slide, 0)), 100), *motions))
    verify(prepared, read(files, FILE))
    run = carry_out(*files.values())
    assert run[-2:] == ["return", ".end"]
    # The executed statements are a program too, with reals in single precision.
    text = "\n".join(line for line in run if "auto real" not in line) + "\n"
    done = read({"a": text.replace(" ( ", "(").replace("- ", "-").replace("auto", "AUTO")}, {})
    assert [f for f in done.findings if "AUTO" not in f.what] == []
    moves = [item for item in done.body if isinstance(item, (MoveJ, MoveL))]
    for planned, executed in zip(prepared.columns.moves, moves, strict=True):
        a, b = (
            move.target.values if isinstance(move.target, Joints) else move.target.origin
            for move in (planned, executed)
        )
        assert np.abs(np.subtract(a, b)).max() < 1.1e-3  # half a digit and the step of a single
        tolerance = 0.004 if isinstance(planned, MoveJ) else 0.002
        assert planned.speed == pytest.approx(executed.speed, abs=tolerance)


def list_motions(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("move")]


def take_other_data(data: str) -> str:
    """The data of another program with as many records."""
    _, files = render(program(*BODY[:-1], MoveJ(CELL.home, 700)))
    assert files["part.dat"].count("\n") == data.count("\n")
    return files["part.dat"]


def swap_records(data: str) -> str:
    lines = data.split("\n")
    lines[3], lines[4] = lines[4], lines[3]
    return "\n".join(lines)


WRONG: dict[str, Callable[[str], str | None]] = {
    "missing": lambda _: None,
    "empty": lambda _: "",
    "cut": lambda data: data[: len(data) // 2],
    "cut after a record": lambda data: data[: data.index("\n", 100) + 1],
    "one record less": lambda data: data[: data[:-1].rindex("\n") + 1],
    "of another job": take_other_data,
    "a digit": lambda data: data.replace("20500", "20600", 1),
    "a sign": lambda data: data.replace(",-33,", ",33,", 1),
    "two records swapped": swap_records,
    "a record twice": lambda data: data + data.splitlines()[-1] + "\n",
    "letters": lambda data: data.replace(",", ";"),
}
#: A run does not read a record beyond the last one, so it moves as planned.
MOVES_AS_PLANNED = {"a record twice"}


@pytest.mark.parametrize("kind", WRONG)
def test_a_run_with_wrong_data_moves_nothing(kind: str) -> None:
    _, files = render(program(*BODY))
    program_text, data = files.values()
    wrong = WRONG[kind](data)
    assert wrong != data
    run = carry_out(program_text, wrong)
    if kind in MOVES_AS_PLANNED:
        assert run == carry_out(program_text, data)
    else:
        assert list_motions(run) == []
        assert run[-2:] == ["stop", ".end"]
        assert run.index("break") < run.index("signal - 33") < run.index("detach ( )")
    given = {"part.v2": program_text} | ({} if wrong is None else {"part.dat": wrong})
    reading = read(given, FILE)
    assert reading.findings
    assert reading.body == ()


def test_a_data_file_that_changes_between_the_two_passes_stops_the_run() -> None:
    """The second pass checks each record too and does not execute a wrong one."""
    _, files = render(program(*BODY))
    program_text, data = files.values()
    # As if the first pass had seen other data.
    second = program_text.replace("cg.pass = 1\n", "cg.pass = 2\n")
    assert len(list_motions(carry_out(second, data))) == 6
    run = carry_out(second, data.replace("1,0,-1,", "1,0,-2,", 1))
    assert len(list_motions(run)) == 3
    message = next(line for line in run if line.startswith("type"))
    assert run[-5:] == ["signal - 33", message, "detach ( )", "stop", ".end"]


# Refusals of the read-back


@pytest.mark.parametrize(
    ("was", "now", "what"),
    [
        ("cg.sum <> cg.check", "cg.sum < cg.check", "not the reader of a data file"),
        ("    SIGNAL -33\n    TYPE", "    TYPE", "put off after an error"),
        ("    SIGNAL -33\n    TYPE", "    SIGNAL -34\n    TYPE", "put off after an error"),
        ("STOP", "RETURN", "not the reader of a data file"),
        ("cg.d/10000,cg.e", "cg.e/10000,cg.e", "not the reader of a data file"),
        ('"part.dat"', '"other.dat"', "reads other.dat: give it that file, not part.dat"),
        (".END\n", ".END\n.PROGRAM more()\n.END\n", "after the reader"),
        (".END\n", "", "not the reader of a data file: nothing"),
        ("ACCEL (0) 100", "ACCEL (0) 90", "ACCEL other than"),
        ("100\n    BREAK", "100\n    BREAK \x07", "not printable"),
        ('job: stopped"', "job: stopped", "a string that does not end"),
        (".PROGRAM part()", ".PROGRAM move()", "a word of V+"),
    ],
)
def test_a_changed_reader_is_a_fault(was: str, now: str, what: str) -> None:
    prepared, files = render(program(*BODY))
    assert was in files["part.v2"]
    reading = read({**files, "part.v2": files["part.v2"].replace(was, now, 1)}, FILE)
    assert what in reading.findings[0].what
    with pytest.raises(VerifyError):
        verify(prepared, reading)


@pytest.mark.parametrize(
    ("record", "what"),
    [
        ("9,0,0,0,0,0,0,0", "no such record"),
        ("7,0,-33,1,0,0,0,0", "no such record"),
        ("7,1,-33,0,0,0,0,0", "an invalid stop"),
        ("1,2,0,0,0,0,0,0", "an invalid stop"),
        ("6,0,100,10000,100,0,0,0", "an invalid fraction"),
        ("1,0,9000000,0,0,0,0,0", "a number above"),
        ("1,0,+5,0,0,0,0,0", "not a record"),
        ("1,0,05,0,0,0,0,0", "not a record"),
        ("5,0,-5,0,0,0,0,0", "a speed must be positive"),
        ("8,0,0,0,0,0,0,0", "a dwell must be positive"),
    ],
)
def test_an_invalid_record_with_a_right_check_sum_is_a_fault(record: str, what: str) -> None:
    _, files = render(program(*BODY))
    first, *lines = files["part.dat"].splitlines()
    lines[0] = record + ","
    total = int(first.split(",")[1]) % 65521
    for k, line in enumerate(lines):
        values = line.split(",")[:8]
        for value in values:
            total = (31 * total + (int(value) + 2**23) % 65521) % 65521
        lines[k] = ",".join((*values, str(total)))
    reading = read({**files, "part.dat": "\n".join((first, *lines, ""))}, FILE)
    faults = [fault for fault in reading.findings if what in fault.what]
    assert faults
    assert faults[0].line == files["part.v2"].count("\n") + 2


def test_comments_blanks_and_case_of_the_reader_may_differ() -> None:
    prepared, files = render(program(*BODY))
    text = (
        files["part.v2"]
        .replace("WHILE", "while")
        .replace(" MOD ", "  mod ")
        .replace("BREAK", "BREAK ; stop")
    )
    reading = read({**files, "part.v2": text}, FILE)
    assert reading.findings == ()
    verify(prepared, reading)


def test_a_reader_without_its_option_and_an_option_without_its_reader_are_faults() -> None:
    _, files = render(program(*BODY))
    assert read(files, {}).findings
    assert read({}, FILE).findings


# From a drawing to the two files, and back


def test_a_drawing_becomes_two_files_that_verify_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = ROOT / "fixtures" / "parts" / "bracket.dxf"
    job = tmp_path / "bracket.toml"
    job.write_text('[post]\npoints = "file"\n', encoding="utf-8")
    common = ["--post", "vplus", "--job", str(job)]
    assert main(["build", str(part), *common, "-o", str(tmp_path)]) == 0
    text, data = (tmp_path / "bracket.v2", tmp_path / "bracket.dat")
    assert b"\r\n" in text.read_bytes()
    assert b"\r\n" in data.read_bytes()
    assert main(["verify", str(text), str(data), *common]) == 0
    capsys.readouterr()
    data.write_bytes(data.read_bytes()[:-9])
    assert main(["verify", str(text), str(data), *common]) != 0
    assert "bracket.dat line" in capsys.readouterr().out


def test_a_refusal_is_a_camgen_error() -> None:
    with pytest.raises(CamgenError):
        render(program(MoveJ(CELL.home, 100), Wait(9e6)))
