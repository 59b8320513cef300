"""Several operations in one job: their contours, their order, their tools and their programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import ezdxf
import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import Choice as Row
from camgen.model.job import OperationTable, ProcessTable, Step, ToolTable
from camgen.model.pose import Pose, Vec3
from camgen.model.program import MoveC, MoveJ, MoveL, Output, ToolChange
from camgen.order import JobTour
from camgen.pipeline.stock import explain_unproven
from camgen.plan.steps import order_steps
from camgen.post.plugins import find_readback
from fixtures.program_text import dump, parse
from tests.support.built import build
from tests.support.drawn import part, rectangle
from tests.support.rs274 import needs_rs274, run

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
TOOLS = [
    {"name": "drill 5", "number": 1, "kind": "drill", "diameter": 5, "speed": 3000, "feed": 3},
    {"name": "mill 6", "number": 2, "diameter": 6, "speed": 12000, "feed": 15},
]


def make_job(*operations: Mapping[str, object], **tables: object) -> dict[str, object]:
    return {"tools": TOOLS, "operations": list(operations), **tables}


#: The same tools for a robot, whose tool frames have these lengths, mm.
TOOLS_OF_TWO_LENGTHS = [TOOLS[0] | {"length": 120.0}, TOOLS[1] | {"length": 90.0}]
SIGNALS = {"signals": {"spindle": "aoSpindle", "process": "doProcess"}}
DRILL = {"kind": "drill", "tool": 1, "depth": 7, "holes": [7.9, 8.1]}
OUTER = {"kind": "follow", "tool": "mill 6", "nesting": "outer", "depth": 6, "passes": 2}
INNER = {"kind": "follow", "tool": "mill 6", "ids": ["c4"], "depth": 6, "passes": 2}


def make_step(kind: str, tool: str) -> Step:
    return Step(ToolTable(name=tool), OperationTable(kind=kind), ProcessTable(), Row())


@pytest.mark.parametrize(
    ("listed", "worked", "run"),
    [
        (["follow", "pocket", "drill"], ["a", "b", "c"], ["drill", "pocket", "follow"]),
        (["follow", "drill"], ["a", "a"], ["follow", "drill"]),  # they work on one contour
        (["trace", "chamfer", "fill"], ["a", "b", "c"], ["trace", "fill", "chamfer"]),
        (["follow", "drill", "pocket"], ["a", "a", "b"], ["pocket", "follow", "drill"]),
    ],
)
def test_holes_come_before_pockets_and_pockets_before_profiles(
    listed: list[str], worked: list[str], run: list[str]
) -> None:
    order = order_steps(
        [make_step(kind, kind) for kind in listed], [frozenset(ids) for ids in worked]
    )
    assert [listed[k] for k in order] == run


def test_operations_of_one_tool_run_one_after_the_other_if_the_order_allows_it() -> None:
    steps = [make_step("drill", tool) for tool in ("a", "b", "a")]
    assert order_steps(steps, [frozenset("x"), frozenset("y"), frozenset("z")]) == [0, 2, 1]
    # A countersink comes after its hole: the third operation works on the hole of the second.
    assert order_steps(steps, [frozenset("x"), frozenset("y"), frozenset("y")]) == [0, 1, 2]


def test_a_profile_comes_after_the_profiles_inside_it_although_the_tool_changes() -> None:
    steps = [make_step("follow", tool) for tool in ("a", "b", "a")]
    contours = [frozenset({"counterbore"}), frozenset({"slot"}), frozenset({"outline"})]
    inside = [frozenset[str](), frozenset[str](), frozenset({"counterbore", "slot"})]
    assert order_steps(steps, contours, inside) == [0, 1, 2]
    assert order_steps(steps, contours) == [0, 2, 1]
    # If each lies inside a contour of the other, their order is that of the list.
    mutual = [frozenset({"slot"}), frozenset({"counterbore"}), frozenset[str]()]
    assert order_steps(steps, contours, mutual) == [0, 2, 1]


def test_each_operation_works_on_its_contours_and_on_the_right_side() -> None:
    result = build(BRACKET, post="gcode", job=make_job(OUTER, INNER, DRILL))
    assert isinstance(result.tour, JobTour)
    assert result.tour.numbers == (2, 1, 0)  # the slot before the outline around it
    contours = {c.id: c for c in result.part.contours}
    reached = {path.id: path for path in result.tour.paths}
    assert {path.operation for path in reached.values()} == {"drill", "follow"}
    outer = next(path for name, path in reached.items() if name.startswith("0:"))
    (name,) = outer.contours
    # The tool centre runs one radius outside of the outline and one radius inside of the slot,
    # although the operation of the slot selects no other contour.
    grown = np.ptp(outer.position[:, :2], axis=0) - np.ptp(contours[name].points, axis=0)
    assert grown == pytest.approx([6.0, 6.0], abs=1e-6)
    slot = reached["1:c4"]
    height = (contours["c4"].points[:, 1].min() + 3.0, contours["c4"].points[:, 1].max() - 3.0)
    assert (slot.position[:, 1].min(), slot.position[:, 1].max()) == pytest.approx(height)
    assert sorted(reached) == ["0:c1", "1:c4", "2:c2", "2:c3"]


def test_the_report_has_a_row_for_each_operation() -> None:
    result = build(BRACKET, post="grbl", job=make_job(OUTER, DRILL | {"holes": [7.9, 8.1]}))
    drilled, cut = result.report["operations"]  # type: ignore[misc]
    assert [drilled[key] for key in ("number", "kind", "tool", "paths")] == [
        1,
        "drill",
        "drill 5",
        2,
    ]
    assert drilled["removed_mm3"] == pytest.approx(2 * 7.0 * np.pi * 2.5**2, rel=5e-3)
    # A ring 6 mm wide and 6 mm deep around the outline of 80 x 50 mm with corner radius 10 mm.
    around = 2 * (60 + 30) + 2 * np.pi * 10
    assert cut["removed_mm3"] == pytest.approx(6.0 * (around * 6 + np.pi * 36), rel=5e-3)
    stock = result.report["stock"]
    assert stock["removed_mm3"] == pytest.approx(
        drilled["removed_mm3"] + cut["removed_mm3"], abs=0.2
    )  # type: ignore[index]
    assert drilled["time_s"] + cut["time_s"] <= result.report["time_s"]  # type: ignore[operator]


def test_an_operation_without_a_kind_takes_its_side_from_all_contours_of_the_part() -> None:
    make_job = {
        "tools": [{"name": "mill", "number": 1, "diameter": 6.0}],
        "operations": [{"tool": "mill", "nesting": "inner"}],
    }
    window = rectangle(20, 20, 60, 40, "window")
    plan = camgen.plan(part(rectangle(0, 0, 100, 80, "outline"), window), make_job)
    (path,) = plan.paths
    assert path.operation == "follow"
    assert path.position[:, 0].min() == pytest.approx(23.0)


def test_circles_selected_by_diameter_may_be_followed() -> None:
    rows = [INNER | {"ids": [], "holes": [7.0, 9.0]}]
    result = build(BRACKET, post="gcode", job=make_job(*rows))
    assert {path.id for path in result.tour.paths} == {"0:c2", "0:c3"}


def test_the_tool_is_changed_at_home_with_the_spindle_off() -> None:
    result = build(BRACKET, post="gcode", job=make_job(OUTER, INNER, DRILL))
    body = result.program.body
    changes = [k for k, item in enumerate(body) if isinstance(item, ToolChange)]
    assert [item.number for item in body if isinstance(item, ToolChange)] == [1, 2]
    for k in changes:
        spindle = [
            item.value for item in body[:k] if isinstance(item, Output) and item.signal == "spindle"
        ]
        assert spindle[-1] == 0.0
        following = next(item for item in body[k + 1 :] if isinstance(item, MoveJ))
        assert following.target.origin == (0.0, 0.0, 50.0)  # type: ignore[union-attr]
    before = [item for item in body[: changes[1]] if isinstance(item, MoveJ)][-1]
    assert isinstance(before.target, Pose)
    assert before.target.origin == (0.0, 0.0, 50.0)
    text = dump(result.program)
    assert dump(parse(text)) == text


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("G43 H2\n", "", "the length of tool 2 is not applied (G43 H2) before it moves"),
        ("G43 H2\n", "G43 H1\n", "G43 H1 shifts z by the length of another tool than T2"),
        ("T2 M6\n", "T3 M6\n", "G43 H2 shifts z by the length of another tool than T3"),
        ("T2 M6\n", "M6\n", ""),
        ("M5\nG0 X0 Y0 Z50\n(tool mill", "G0 X0 Y0 Z50\n(tool mill", "tool 2 is changed while"),
    ],
)
def test_a_read_back_finds_the_fault_of_a_tool_change(old: str, new: str, fault: str) -> None:
    result = build(BRACKET, post="gcode", job=make_job(OUTER, DRILL))
    assert not find_readback("gcode")({"a.ngc": result.text}, {}).findings
    assert result.text.count(old) == 1
    reading = find_readback("gcode")({"a.ngc": result.text.replace(old, new)}, {})
    planned = [item.number for item in result.program.body if isinstance(item, ToolChange)]
    if fault:
        assert any(fault in finding.what for finding in reading.findings)
    else:
        assert planned != [item.number for item in reading.body if isinstance(item, ToolChange)]


def test_a_controller_without_tool_changes_gets_one_program_per_tool() -> None:
    result = build(BRACKET, post="grbl", job=make_job(OUTER, INNER, DRILL))
    assert [file.name for file in result.files] == ["bracket_1.nc", "bracket_2.nc"]
    assert result.counts == (1, 1)
    for file, lowest in zip(result.files, (-7.0, -6.0), strict=True):
        reading = find_readback("grbl")({file.name: file.text}, {})
        assert not reading.findings
        motions = [item for item in reading.body if isinstance(item, MoveL | MoveC)]
        assert min(motion.target.origin[2] for motion in motions) == lowest
    assert "drill 5" in result.files[0].text
    assert "mill 6" in result.files[1].text


def test_every_program_of_a_robot_has_the_frame_of_its_tool() -> None:
    tables = make_job(OUTER, DRILL, post=SIGNALS, tools=TOOLS_OF_TWO_LENGTHS)
    result = camgen.build(BRACKET, post="rapid", job=tables | {"cell": {"robot": "IRB 120"}})
    assert [file.name for file in result.files] == ["bracket_1.mod", "bracket_2.mod"]
    readings = [
        find_readback("rapid")({file.name: file.text}, tables["post"]) for file in result.files
    ]  # type: ignore[arg-type]
    assert [reading.tool.origin[2] for reading in readings if reading.tool] == [120.0, 90.0]
    assert result.reach is not None
    assert len(result.reach.joints) > 100


def test_a_job_with_one_tool_without_a_number_has_no_tool_change() -> None:
    rows = [
        {"kind": "follow", "nesting": "outer", "depth": 2},
        {"kind": "trace", "layers": ["HOLES"], "depth": 0.5},
    ]
    result = camgen.build(
        BRACKET, post="grbl", job={"operations": rows, "process": {"spindle": 9000.0}}
    )
    assert [file.name for file in result.files] == ["bracket.nc"]
    assert not [item for item in result.program.body if isinstance(item, ToolChange)]
    assert next(path.operation for path in result.tour.paths) == "trace"


@pytest.mark.parametrize(
    ("rows", "error", "message"),
    [
        (
            [OUTER | {"tool": "mill 7"}],
            JobError,
            'job: there is no tool "mill 7" ([[operations]] 0)',
        ),
        ([{"kind": "follow"}], JobError, "job: names no tool ([[operations]] 0)"),
        ([OUTER | {"dept": 3}], JobError, 'job: unknown key "dept" ([[operations]] 0)'),
        ([OUTER | {"depth": "deep"}], JobError, "job: depth must be a number >= 0"),
        ([OUTER | {"ids": ["c99"]}], InputError, "there is no contour 'c99'"),
        ([OUTER | {"layers": ["NOTHING"]}], InputError, "chooses no contour"),
        (
            [OUTER | {"colors": ["redd"]}],
            JobError,
            'job: there is no color "redd" ([[operations]] 0); one of red, ',
        ),
        (
            [OUTER | {"colors": ["blue"]}],
            InputError,
            "no contour has the color 'blue' (operations.0.colors); there are",
        ),
    ],
)
def test_a_wrong_operation_is_refused_with_its_key(
    rows: Sequence[Mapping[str, object]], error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as caught:
        build(BRACKET, post="gcode", job=make_job(*rows))
    assert message in str(caught.value)


@pytest.mark.parametrize("colors", [["red"], ["1"], ["#FF0000"], ["RED", "blue"]])
def test_an_operation_works_on_the_contours_of_its_colors(
    colors: list[str], tmp_path: Path
) -> None:
    document = ezdxf.new("R2010", units=4)
    for k, color in enumerate((1, 5, 3, 1)):
        document.modelspace().add_circle((30 * k, 0), 8, dxfattribs={"color": color})
    file = tmp_path / "part.dxf"
    document.saveas(file)
    rows = [{"kind": "trace", "colors": colors}]
    result = camgen.build(
        file, post="gcode", job={"operations": rows, "process": {"spindle": 9000.0}}
    )
    wanted = {"c1", "c4"} | ({"c2"} if "blue" in colors else set())
    assert set().union(*(path.contours for path in result.tour.paths)) == wanted


def test_a_tool_without_a_number_is_refused_if_tools_are_changed() -> None:
    tools = [{"name": "a", "diameter": 5.0}, {"name": "b", "diameter": 6.0}]
    rows = [OUTER | {"tool": "a", "spindle": 9000.0}, DRILL | {"tool": "b", "spindle": 9000.0}]
    with pytest.raises(Exception, match="tool b has no number in the tool table"):
        camgen.build(BRACKET, post="gcode", job={"tools": tools, "operations": rows})


@pytest.mark.parametrize(
    ("post", "names"), [("gcode", ["bracket.ngc"]), ("grbl", ["bracket_1.nc", "bracket_2.nc"])]
)
def test_the_commands_build_and_verify_a_job_of_two_tools(
    post: str,
    names: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [
        "[[tools]]\nname = 'a'\nnumber = 1\ndiameter = 4",
        "[[tools]]\nname = 'b'\nnumber = 2\ndiameter = 6",
    ]
    rows += ["[[operations]]\ntool = 'a'\nkind = 'trace'\ndepth = 0.5\nlayers = ['holes']"]
    rows += [
        "[[operations]]\ntool = 2\nkind = 'follow'\nnesting = 'outer'\n[process]\nspindle = 9000"
    ]
    Path("job.toml").write_text("\n".join(rows))
    command = ["build", str(BRACKET), "--post", post, "--job", "job.toml", "--plan", "plan.json"]
    assert main([*command, "--set", "operations.1.depth=3"]) == 0
    errors = capsys.readouterr().err
    assert "operation 0 trace - a, 3 paths" in errors
    assert "operation 1 follow - b, 1 path" in errors
    for name in names:
        assert main(["verify", name, "--post", post, "--plan", "plan.json"]) == 0
    assert "z -3 to 50" in capsys.readouterr().out
    assert main([*command, "--set", "operations.2.depth=3"]) == 2
    assert (
        "there is no operations.2: the job has 2 rows of [[operations]]" in capsys.readouterr().err
    )


@needs_rs274
def test_the_interpreter_of_linuxcnc_changes_the_tools() -> None:
    """After each tool change the tool moves up, across and down, and then as planned."""
    result = build(BRACKET, post="gcode", job=make_job(OUTER, DRILL, post={"cycles": False}))
    canon = run(result.text, "T1 P1 Z0 D5\nT2 P2 Z0 D6\n")
    assert canon.error == ""
    assert [name for name in canon.names if name in ("CHANGE_TOOL", "USE_TOOL_LENGTH_OFFSET")] == [
        "USE_TOOL_LENGTH_OFFSET",  # G49
        *("CHANGE_TOOL", "USE_TOOL_LENGTH_OFFSET") * 2,
    ]
    wanted: list[Vec3 | None] = []
    for item in result.program.body:
        if isinstance(item, ToolChange):
            wanted += [None, None]  # up to the top, and across
        elif isinstance(item, MoveJ | MoveL | MoveC):
            assert isinstance(item.target, Pose)
            wanted.append(item.target.origin)
    kinds = ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED")
    calls = [call for call in canon.calls if call.kind in kinds]
    for target, call in zip(wanted, calls[len(calls) - len(wanted) :], strict=True):
        assert target is None or call.end == pytest.approx(target, abs=5.6e-4)
    without = run(result.text, "T1 P1 Z0 D5\n")
    assert "2" in without.error


def test_a_program_of_several_tools_is_proven_against_its_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The program of the motor plate passes, but not without its fourth motion upwards.

    Then the tool is dragged through the plate.
    """
    fixtures = BRACKET.parents[1]
    monkeypatch.chdir(tmp_path)
    text = (fixtures / "cases" / "motor-plate" / "expected" / "part.ngc").read_text()
    lines = text.splitlines()
    lost = [k for k, line in enumerate(lines) if line == "G0 Z10"][3]
    Path("good.ngc").write_text(text)
    Path("bad.ngc").write_text("\n".join([*lines[:lost], *lines[lost + 1 :]]) + "\n")
    part, job = fixtures / "parts" / "motor.dxf", fixtures / "cases" / "motor-plate" / "job.toml"
    command = ["--post", "gcode", "--part", str(part), "--job", str(job)]
    assert main(["verify", "good.ngc", *command]) == 0
    assert "no gouge, no rapid motion in material" in capsys.readouterr().out
    assert main(["verify", "bad.ngc", *command]) == 3
    output = capsys.readouterr()
    # The next motion after the missing line. Its line number is its index, as one line is missing.
    dragged = next(k for k, line in enumerate(lines) if k > lost and line.startswith("G"))
    assert f"bad.ngc line {dragged:,}".replace(",", " ") in output.err
    assert "rapid motion through material" in output.out
    Path("none.ngc").write_text(text.replace("T3 M6", "T9 M6").replace("G43 H3", "G43 H9"))
    assert main(["verify", "none.ngc", *command]) == 2
    assert "changes to tool 9, which no operation names" in capsys.readouterr().err


def test_the_outline_of_the_stock_is_not_machined() -> None:
    """The outline of the bracket is the stock, so its holes are the contours of the part."""
    tables = {
        "stock": {"layer": "OUTLINE", "thickness": 4.0},
        "operation": {"depth": 2.0, "side": "inside"},
    }
    tables["process"] = {"spindle": 9000.0}
    result = camgen.build(BRACKET, post="gcode", job=tables)
    worked = set().union(*(path.contours for path in result.tour.paths))
    assert worked == {"c2", "c3", "c4"}
    assert any("the stock, not machined" in note.what for note in result.notes)
    with pytest.raises(InputError, match="no closed contour on layer 'RAW'"):
        camgen.build(BRACKET, post="gcode", job=tables | {"stock": {"layer": "RAW"}})


@pytest.mark.parametrize("number", [0, 7])
def test_a_robot_with_one_tool_has_its_frame_with_a_number_and_without(number: int) -> None:
    """The default length of [tool] is 100 mm. The tool of [[tools]] is 180 mm long and is used."""
    tools = [{"name": "long", "number": number, "diameter": 6.0, "length": 180.0, "speed": 9000.0}]
    tables = {"tools": tools, "operations": [OUTER | {"tool": "long"}], "post": SIGNALS}
    result = camgen.build(BRACKET, post="rapid", job=tables)
    (file,) = result.files
    reading = find_readback("rapid")({file.name: file.text}, SIGNALS)
    assert reading.tool is not None
    assert reading.tool.origin == (0.0, 0.0, 180.0)
    assert result.program.flange_from_tool.origin == (0.0, 0.0, 180.0)
    assert "tool: long - diameter 6 mm - frame 0 0 180 0 0 0" in file.text


def test_an_operation_without_a_contour_does_not_stop_the_others() -> None:
    result = build(BRACKET, post="gcode", job=make_job(OUTER, DRILL | {"holes": [1.0, 2.0]}))
    assert {path.operation for path in result.tour.paths} == {"follow"}
    assert any(
        note.kind == "skipped" and "operation 1 (drill): no hole to drill" in note.what
        for note in result.notes
    )
    tables = make_job(OUTER, DRILL | {"holes": [1.0, 2.0]})
    with pytest.raises(NoSafeProgram, match="--strict"):
        camgen.build(BRACKET, post="gcode", job=tables, strict=True)


@pytest.mark.parametrize(
    ("row", "planner"), [({"kind": "fill"}, "fill"), ({"planner": "image"}, "the image planner")]
)
def test_an_operation_on_the_whole_picture_refuses_single_contours(
    row: dict[str, object], planner: str
) -> None:
    gear = BRACKET.parent / "gear.png"
    tables = {"image": {"width_mm": 60.0}, "tool": {"diameter": 2.0}}
    with pytest.raises(
        JobError, match=f"{planner} works on the whole picture, not on single contours"
    ):
        camgen.build(gear, post="gcode", job=tables | {"operations": [row | {"ids": ["c1"]}]})


def test_a_program_of_the_image_planner_has_no_stock_proof() -> None:
    """Its paths deviate by a fraction of a pixel, which is not a gouge.

    The summary states that the stock was not tested.
    """
    tables = {
        "image": {"width_mm": 60.0},
        "tool": {"diameter": 2.0},
        "process": {"spindle": 9000.0},
    }
    tables["operation"] = {"planner": "image", "depth": 1.0}
    result = camgen.build(BRACKET.parent / "gear.png", post="gcode", job=tables)
    assert result.proof is None
    assert explain_unproven(result.job).startswith("the image planner")


@pytest.mark.parametrize("key", ["acceleration", "turn", "max_feed"])
def test_an_operation_refuses_a_setting_of_the_whole_program(key: str) -> None:
    with pytest.raises(JobError, match=f"{key} holds for the whole program"):
        camgen.job(make_job(OUTER | {key: 100.0}))


def test_one_tool_frame_is_refused_for_tools_of_several_lengths() -> None:
    cell = {"flange_from_tool": [0, 0, 150, 0, 0, 0]}
    tables = make_job(OUTER, DRILL, post=SIGNALS, cell=cell, tools=TOOLS_OF_TWO_LENGTHS)
    with pytest.raises(JobError, match="is one frame, and the tools have several lengths"):
        camgen.build(BRACKET, post="rapid", job=tables)
