"""Replay of G-code: several tools, cutter compensation, dialects, and subprograms in files."""

import math
from pathlib import Path

import pytest

import camgen
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output, ToolChange

OLD = """\
%
O0001
G21 G90 G17 G54
T1 M6
S9000 M3
G0 X10 Y10
G43 H1 Z5 M8
G1 Z-1 F300
X40
G0 Z20
T2 M6
S8000 M3
G0 X0 Y0
G43 H2 Z5
G1 Z-2 F240
Y50
G0 Z30
M9 M5
T1 M6
M30
%
"""
ROWS = [
    {"number": 1, "diameter": 10.0, "length": 80.0, "name": "mill"},
    {"number": 2, "diameter": 4.0, "length": 60.0},
]
FLOOD = {"signals": {"flood": "M8"}}


def replay(
    tmp_path: Path,
    text: str = OLD,
    post: str = "gcode",
    options: dict[str, object] | None = None,
    **tables,
):
    (tmp_path / "old.nc").write_text(text)
    return camgen.build(
        tmp_path / "old.nc",
        post=post,
        job={**tables, "post": FLOOD if options is None else options},
    )


def list_texts(body):
    """A short text for each tool change, output and motion."""
    for item in body:
        if isinstance(item, ToolChange):
            yield f"T{item.number}"
        elif isinstance(item, Output):
            yield f"{item.signal} {item.value:g}"
        elif isinstance(item, MoveJ | MoveL | MoveC):
            pose = not isinstance(item.target, Joints)
            position = "{:g} {:g} {:g}".format(*item.target.origin) if pose else ""
            yield type(item).__name__ + position


def test_each_tool_has_its_part_of_the_program(tmp_path):
    """A tool is changed at home with all outputs off.

    A coolant that was on is switched on again above the first position after the change.
    """
    result = replay(tmp_path)
    assert list(list_texts(result.program.body)) == [
        "spindle 0",
        "flood 0",
        "T1",
        "MoveJ0 0 50",
        "MoveJ10 10 20",
        "spindle 9000",
        "flood 1",
        "MoveJ10 10 5",
        "MoveL10 10 -1",
        "MoveL40 10 -1",
        "MoveJ40 10 20",
        "spindle 0",
        "flood 0",
        "MoveJ0 0 50",
        "T2",
        "MoveJ0 0 50",
        "MoveJ0 0 20",
        "flood 1",
        "spindle 8000",
        "MoveJ0 0 5",
        "MoveL0 0 -2",
        "MoveL0 50 -2",
        "MoveJ0 50 30",
        "spindle 0",
        "flood 0",
        "MoveJ0 0 50",
    ]
    assert [str(note) for note in result.notes if "tool" in note.what or "T1" in note.what] == [
        (
            "skipped: line 19: tool T1 is loaded and cuts nothing (the change and its rapid "
            "motions are left out)"
        ),
        (
            "assumed: T1, T2: of the machine's tool table (no row of [[tools]] has their "
            "length and diameter)"
        ),
        "assumed: line 7: z is that of the tip of the tool: its length (G43) is in no program",
    ]
    statements = [line for line in result.text.split("\n") if not line.startswith("(")]
    assert [line for line in statements if "T" in line] == ["T1 M6", "T2 M6"]
    assert [path.id for path in result.tour.paths] == ["n1", "n2"]


def test_a_row_of_tools_states_name_and_size(tmp_path):
    result = replay(tmp_path, tools=ROWS)
    changes = [item for item in result.program.body if isinstance(item, ToolChange)]
    assert [(item.name, item.diameter, item.length) for item in changes] == [
        ("mill", 10, 80),
        ("", 4, 60),
    ]
    assert not any("tool table" in note.what for note in result.notes)


@pytest.mark.parametrize(
    ("post", "options"),
    [
        ("rapid", {"signals": {"flood": "doFlood", "spindle": "aoSpindle"}}),
        ("grbl", FLOOD),
    ],
)
def test_a_controller_without_tool_changes_gets_a_program_per_tool(tmp_path, post, options):
    result = replay(tmp_path, post=post, options=options, tools=ROWS)
    assert result.counts == (1, 1)
    assert len({file.name for file in result.files}) == 2
    if post == "rapid":  # each has the frame of its tool
        assert "[[0.000,0.000,80.000]" in result.files[0].text
        assert "[[0.000,0.000,60.000]" in result.files[1].text


def test_an_arm_needs_the_length_of_each_tool(tmp_path):
    with pytest.raises(InputError) as caught:
        replay(tmp_path, post="rapid", tools=ROWS[:1])
    assert str(caught.value) == (
        "old.nc: changes to tool T2, whose length is not known (line 11); give each tool a "
        "row of [[tools]] "
        "with its number, length and diameter"
    )


def test_a_cut_before_the_first_tool_change_is_refused(tmp_path):
    with pytest.raises(
        InputError,
        match=r"cuts before its first tool change, to T2, and does not state with which tool",
    ):
        replay(tmp_path, OLD.replace("T1 M6\nS9000", "S9000"))
    # Rapid motions before the first change are left out: the machine starts at its home.
    moved = replay(tmp_path, OLD.replace("T1 M6\nS9000", "G0 X9 Y9 Z9\nT1 M6\nS9000"))
    assert not any("9 9 9" in text for text in list_texts(moved.program.body))
    assert any(
        note.what == "line 4: rapid motions before the first tool change are left out"
        for note in moved.notes
    )


def test_a_program_with_one_tool_changes_it_only_if_the_job_numbers_it(tmp_path):
    single = OLD.replace("T2 M6\n", "")
    assert not any(isinstance(item, ToolChange) for item in replay(tmp_path, single).program.body)
    named = replay(tmp_path, single, tool={"number": 1, "diameter": 8.0})
    assert [item.diameter for item in named.program.body if isinstance(item, ToolChange)] == [8]


def test_a_cut_right_after_a_tool_change_is_approached_at_its_feed(tmp_path):
    """The tool goes to the clearance height, then down at the feed of the cut."""
    text = "G21 G90\nT1 M6\nG0 X0 Y0 Z2\nG1 Z-1 F60\nT2 M6\nG1 X9 F120\nM2\n"
    body = replay(tmp_path, text, options={"cycles": False}).program.body
    moves = [item for item in body if isinstance(item, MoveJ | MoveL)]
    at = [(type(item).__name__, *item.target.origin) for item in moves]
    assert at[5:11] == [
        ("MoveJ", 0, 0, 50),
        ("MoveJ", 0, 0, 50),
        ("MoveJ", 0, 0, 20),
        ("MoveL", 0, 0, -1),
        ("MoveL", 9, 0, -1),
        ("MoveJ", 9, 0, 20),
    ]
    assert moves[8].speed == 2.0


SQUARE = (
    "G21 G90\nT3 M6\nG0 X-10 Y-10 Z5\nG41 D3 G1 X0 Y0 F600\nZ-1\n"
    "Y20\nX20\nY0\nX0\nZ5\nG40 X-10 Y-10\nM2\n"
)


@pytest.mark.parametrize(
    "tables",
    [
        {"tools": [{"number": 3, "diameter": 4.0}]},
        {"tool": {"number": 3, "diameter": 4.0}},
        {"tool": {"diameter": 4.0}},
    ],
)
def test_a_compensated_path_is_offset_by_the_radius_of_the_tool(tmp_path, tables):
    """G41 on a clockwise square is 2 mm outside of it, with arcs at its corners."""
    columns = replay(tmp_path, SQUARE, options={}, **tables).program.columns
    low = columns.ends[:, 2] == -1
    assert columns.ends[low][:, :2].min() == pytest.approx(-2)
    assert columns.ends[low][:, :2].max() == pytest.approx(22)
    assert sum(isinstance(item, MoveC) for item in columns.moves) == 3


def test_compensation_without_a_radius_is_refused_or_run_as_programmed(tmp_path):
    with pytest.raises(InputError) as caught:
        replay(tmp_path, SQUARE, options={})
    assert str(caught.value).removeprefix(f"{tmp_path}/") == (
        "old.nc: G41: the path depends on the radius of tool 3, which is not known (line 4); "
        "give tool 3 a row of [[tools]] with its number and diameter, "
        'or operation.compensation = "as-programmed"'
    )
    result = replay(tmp_path, SQUARE, options={}, operation={"compensation": "as-programmed"})
    low = result.program.columns.ends[:, 2] == -1
    assert result.program.columns.ends[low][:, :2].min() == 0
    assert any(
        "the path is run as programmed, the tool on it" in note.what for note in result.notes
    )


def test_the_dialect_follows_from_the_words_of_a_program(tmp_path):
    """In Fanuc P of G4 is in ms, M98 P21000 runs O1000 twice, and W is an increment of Z."""
    text = "%\nO0001\nG21 G90 G0 X0 Y0 Z5\nG4 P500\nM98 P21000\nM30\nO1000\nG1 W-1. F60.\nM99\n%\n"
    result = replay(tmp_path, text, options={})
    assert "G4 P0.5" in result.text
    assert [z for *_, z in result.program.columns.ends.tolist()][2:5] == [5, 4, 3]
    with pytest.raises(InputError, match="line 8"):  # LinuxCNC has another W
        replay(tmp_path, text.replace("P21000", "P1000"), options={}, input={"dialect": "linuxcnc"})


def test_a_subprogram_may_be_in_another_file(tmp_path):
    (tmp_path / "main.nc").write_text("G21 G90 G0 X0 Y0 Z5\nM98 P1000\nM30\n")
    (tmp_path / "1000.nc").write_text("G1 Z-1 F60\nX9\nM99\n")
    result = camgen.build([tmp_path / "main.nc", tmp_path / "1000.nc"], post="gcode")
    assert result.program.columns.ends[3].tolist() == [0, 0, -1]
    assert result.part.source == "main.nc + 1000.nc"
    with pytest.raises(
        InputError, match=r"main\.nc: M98 P1000: the subprogram is not in this file \(line 2\)"
    ):
        camgen.build(tmp_path / "main.nc", post="gcode")


def test_a_value_of_the_machine_may_be_assumed_in_the_job(tmp_path):
    text = "G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F60\nX#5221\nM2\n"
    with pytest.raises(InputError, match="#5221 is a value of the machine"):
        replay(tmp_path, text, options={})
    result = replay(tmp_path, text, options={}, input={"assume": {"#5221": 7.0}})
    assert math.isclose(result.program.columns.ends[:, 0].max(), 7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "G21 G0 X0 Y0 Z5\nG1 X5 E2 F600\nM104 S200\n",
            r"E feeds filament: only X, Y and Z are replayed \(line 2\)",
        ),
        ("G21 G0 X0 Y0 Z5\nG1 X5 F60\nM777\n", r"M777 is not known and not evaluated \(line 3\)"),
        (
            "G21 G0 X0 Y0 Z5\nG1 X5 F60\nG1 A90\n",
            r"axis A moves: only X, Y and Z are replayed \(line 3\)",
        ),
        (
            "G21 G0 X0 Y0 Z5\nG1 X5\n",
            r"the feed before the first F is one of the machine's, mm/min \(line 2\)",
        ),
    ],
)
def test_a_program_with_an_effect_that_would_be_lost_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        replay(tmp_path, text, options={})


def test_a_setting_of_a_replay_is_refused_for_a_drawing(tmp_path):
    drawing = camgen.part([(0, 0), (30, 0)])
    for tables, key in (
        ({"input": {"dialect": "fanuc"}}, r"input\.dialect"),
        ({"input": {"assume": {"a": 1.0}}}, r"input\.assume"),
        ({"operation": {"compensation": "as-programmed"}}, r"operation\.compensation"),
    ):
        with pytest.raises(JobError, match=rf"has no effect on a drawing \({key}\)"):
            camgen.build(drawing, post="gcode", job=tables)
    with pytest.raises(JobError, match="has tools and no operation that names one"):
        camgen.build(drawing, post="gcode", job={"tools": [{"number": 1}]})
    (tmp_path / "old.nc").write_text(OLD)
    with pytest.raises(NoSafeProgram, match="cuts nothing"):
        camgen.build(tmp_path / "old.nc", post="gcode", job={"post": FLOOD}, strict=True)
