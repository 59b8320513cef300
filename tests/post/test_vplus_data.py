"""Points of a V+ program in a data file: what is written, that a run of it does what was planned and nothing else
where the data are not its own, and what the read-back refuses.
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
from tests.support.whole import whole

ROOT = Path(__file__).parents[2]
CELL = VPlus.cell()
FILE: dict[str, object] = {"points": "file"}
HOME6 = MoveJ(Joints((0.1, -0.2, 0.3, -0.4, 0.5, -0.6)), 100.0)


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


def made(source: Program, **options: object) -> tuple[Program, dict[str, str]]:
    """The program as prepared, and its files, the reader before its data."""
    post = make_post(VPlus, {**FILE, **options})
    prepared = post.prepare(source, 0.01)
    return prepared, {file.name: file.text for file in post.render(prepared)}


def agree(prepared: Program, reading: Executed, **options: object) -> None:
    post = make_post(VPlus, {**FILE, **options})
    compare(prepared, reading, post.tolerance(), post.list_verified(), "part.v2")


# What is written.


def test_the_page_shows_a_reader_and_its_data() -> None:
    page = (ROOT / "docs" / "posts" / "vplus.md").read_text(encoding="utf-8")
    _, files = made(program(*BODY))
    blocks = page.partition("### Points in a data file")[2].split("```\n")
    rest = files["part.v2"]
    for piece in blocks[1].split("...\n"):  # in order; the page leaves out repetitions
        assert piece in rest
        rest = rest.partition(piece)[2]
    assert rest == ""
    assert blocks[3] == files["part.dat"]


def test_the_lines_of_the_reading_are_those_of_the_data() -> None:
    prepared, files = made(program(*BODY))
    reading = read(files, FILE)
    assert reading.findings == ()
    agree(prepared, reading)
    lines = "".join(files.values()).splitlines()
    kinds = {MoveL: "1", MoveJ: "234", Output: "7", Wait: "8"}
    for item, line in zip(reading.body, reading.lines, strict=True):
        assert lines[line - 1].partition(",")[0] in kinds[type(item)]


def test_the_same_program_in_both_ways_reads_alike() -> None:
    source = program(*BODY)
    _, files = made(source)
    post = make_post(VPlus, {})
    plain = read({file.name: file.text for file in post.render(post.prepare(source, 0.01))}, {})
    other = read(files, FILE)
    assert [type(item) for item in plain.body] == [type(item) for item in other.body]
    agree(source.with_body(plain.body), other)


def test_postures_and_six_axes_are_records_too() -> None:
    words = Posture(switches=("LEFTY", "ABOVE", "NOFLIP", "SINGLE"))
    body = (
        HOME6,
        MoveJ(down(1, 2, 3), 100, posture=words),
        MoveL(down(4, 5, 6), 20, posture=words),
    )
    prepared, files = made(program(*body))
    reading = read(files, FILE)
    assert reading.findings == ()
    agree(prepared, reading)
    _, given = made(program(HOME6, MoveJ(down(1, 2, 3), 100)), posture=["LEFTY", "FLIP"])
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
    # Remarks, and the sign of 180 deg.
    meaningless = (r";.*", r"([,(])180\b", r"[,(](-)180\b")
    check_case(VPlus, VPLUS, case, {**KIT, "points": points}, lacks, meaningless)


@pytest.mark.parametrize(
    ("name", "file"),
    [("part", "part.dat"), ("plate_12", "plate_12.dat"), ("9", "9.dat")],
)
def test_a_name_that_a_disk_takes_stays(name: str, file: str) -> None:
    assert data_name(name) == file


def test_names_that_a_disk_does_not_take_stay_apart() -> None:
    names = ["bracket_left", "bracket_right", "PART", "Part", "a b", "a_b ", "ü", ""]
    files = {data_name(name) for name in names}
    assert len(files) == len(names)
    assert all(
        len(file) <= 12 and file.isascii() and " " not in file and file == file.lower()
        for file in files
    )


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"decimals": 4}, "decimals"),
        ({"tool": "cg.sum"}, "tool"),
        ({"work": "CG.A"}, "work"),
        ({"program": "cg.n"}, "program"),
    ],
)
def test_options_that_do_not_go_with_a_data_file(options: dict[str, object], where: str) -> None:
    make_post(VPlus, {**options, "points": "program"})
    with pytest.raises(JobError, match=rf"\[post\] {where}"):
        make_post(VPlus, {**options, **FILE})


@pytest.mark.parametrize(
    "item",
    [MoveJ(Joints((0, 0, 8388.7, 0)), 100), MoveJ(Joints((15.0, 0, 0, 0)), 100), Wait(9e6)],
)  # fmt: skip
def test_what_has_no_room_in_a_record_is_refused(item: Instruction) -> None:
    source = program(MoveJ(CELL.home, 100), item)
    make_post(VPlus, {}).prepare(source, 0.01)
    with pytest.raises(Refused, match=r"has no room in a record; set post\.points"):
        made(source)


# What a run does. The simulation of the bench calculates in single precision, as the controller.

NUMBER = st.floats(-8191, 8191)
MOTION = st.builds(lambda x, y, z, a, v: MoveL(down(x, y, z, a), v), NUMBER, NUMBER, NUMBER, st.floats(-3, 3),
                   st.floats(0.1, 20000))  # fmt: skip


@given(st.lists(MOTION, min_size=1, max_size=8), st.floats(-6, 6), st.floats(-8000, 8000))
def test_a_run_does_what_was_planned(motions: list[MoveL], angle: float, slide: float) -> None:
    ends = [motion.target.origin for motion in motions]
    assume(
        all(math.dist(a, b) > 1 for a, b in itertools.pairwise(ends))
    )  # a turn on the spot has a speed of its own
    prepared, files = made(program(MoveJ(Joints((angle, 0.5, slide, 0)), 100), *motions))
    agree(prepared, read(files, FILE))
    run = carry_out(*files.values())
    assert run[-2:] == ["return", ".end"]
    # What has been carried out is a program itself; its reals are singles, which camgen's are not.
    text = "\n".join(line for line in run if "auto real" not in line) + "\n"
    done = read({"a": text.replace(" ( ", "(").replace("- ", "-").replace("auto", "AUTO")}, {})
    assert [f for f in done.findings if "AUTO" not in f.what] == []
    for one, other in zip(
        prepared.columns.moves, [i for i in done.body if isinstance(i, (MoveJ, MoveL))], strict=True
    ):
        a, b = (
            m.target.values if isinstance(m.target, Joints) else m.target.origin
            for m in (one, other)
        )
        assert np.abs(np.subtract(a, b)).max() < 1.1e-3  # half a digit and the step of a single
        assert one.speed == pytest.approx(
            other.speed, abs=0.004 * (1 if isinstance(one, MoveJ) else 0.5)
        )


def motions(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("move")]


def of_another(data: str) -> str:
    _, files = made(program(*BODY[:-1], MoveJ(CELL.home, 700)))
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
    "cut behind a record": lambda data: data[: data.index("\n", 100) + 1],
    "one record less": lambda data: data[: data[:-1].rindex("\n") + 1],
    "of another job": of_another,
    "a digit": lambda data: data.replace("20500", "20600", 1),
    "a sign": lambda data: data.replace(",-33,", ",33,", 1),
    "two records swapped": swap_records,
    "a record twice": lambda data: data + data.splitlines()[-1] + "\n",
    "letters": lambda data: data.replace(",", ";"),
}
#: A record too many is not read by a run, and nothing of it is done.
DONE_ALL_THE_SAME = {"a record twice"}


@pytest.mark.parametrize("kind", WRONG)
def test_data_that_are_not_its_own_move_nothing(kind: str) -> None:
    _, files = made(program(*BODY))
    program_text, data = files.values()
    wrong = WRONG[kind](data)
    assert wrong != data
    run = carry_out(program_text, wrong)
    if kind in DONE_ALL_THE_SAME:
        assert run == carry_out(program_text, data)
    else:
        assert motions(run) == []
        assert run[-2:] == ["stop", ".end"]
        assert run.index("break") < run.index("signal - 33") < run.index("detach ( )")
    given = {"part.v2": program_text} | ({} if wrong is None else {"part.dat": wrong})
    reading = read(given, FILE)
    assert reading.findings
    assert reading.body == ()


def test_a_file_that_is_changed_between_the_two_passes_stops_at_once() -> None:
    """The second time it is looked at record by record as well: what is wrong there is not done."""
    _, files = made(program(*BODY))
    program_text, data = files.values()
    # As if the first pass had seen other data.
    second = program_text.replace("cg.pass = 1\n", "cg.pass = 2\n")
    assert len(motions(carry_out(second, data))) == 6
    run = carry_out(second, data.replace("1,0,-1,", "1,0,-2,", 1))
    assert len(motions(run)) == 3
    assert run[-5:] == [
        "signal - 33",
        next(x for x in run if x.startswith("type")),
        "detach ( )",
        "stop",
        ".end",
    ]


# What the read-back refuses.


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
def test_a_program_that_is_not_the_reader(was: str, now: str, what: str) -> None:
    prepared, files = made(program(*BODY))
    assert was in files["part.v2"]
    reading = read({**files, "part.v2": files["part.v2"].replace(was, now, 1)}, FILE)
    assert what in reading.findings[0].what
    with pytest.raises(VerifyError):
        agree(prepared, reading)


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
def test_a_record_that_is_none_though_its_check_is_right(record: str, what: str) -> None:
    _, files = made(program(*BODY))
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


def test_comments_blanks_and_case_do_not_count() -> None:
    prepared, files = made(program(*BODY))
    text = (
        files["part.v2"]
        .replace("WHILE", "while")
        .replace(" MOD ", "  mod ")
        .replace("BREAK", "BREAK ; stop")
    )
    reading = read({**files, "part.v2": text}, FILE)
    assert reading.findings == ()
    agree(prepared, reading)


def test_a_reader_without_its_option_is_a_fault() -> None:
    _, files = made(program(*BODY))
    assert read(files, {}).findings
    assert read({}, FILE).findings


# From a drawing to the two files, and back.


def test_build_and_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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


def test_a_refusal_is_camgens_own() -> None:
    with pytest.raises(CamgenError):
        made(program(MoveJ(CELL.home, 100), Wait(9e6)))
