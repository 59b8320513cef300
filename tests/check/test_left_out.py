"""Paths of a flat part that an arm cannot run are left out with the reason; the rest is built."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.cli.stock import rows_of_build
from camgen.model.errors import Blocked, BlockedPath, NoSafeProgram
from camgen.model.program import Program, ToolChange
from camgen.order import ArmTour, JobTour
from camgen.pipeline import Result, programs
from camgen.plan.leave_out import find_dependent, leave_out_paths

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: The outline of the bracket is 2.5 mm out of reach, its holes are not.
FAR = {"robot": "IRB 1200", "base_from_work": [800, -60, 0, 0, 0, 0]}
NEAR = {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]}
TRACE: dict[str, Any] = {"operation": {"kind": "trace"}}


def build_counted(
    part: Path = PARTS / "bracket.dxf", strict: bool = False, **tables: Any
) -> tuple[Result, int]:
    """Build a part; return the result and the number of programs that were checked."""
    stages: list[str] = []
    post = tables.pop("post", "rapid")
    # A tool without a mass would be refused by --strict as well.
    options = {"post": {"mass": 1.0}} if strict else {}
    result = camgen.build(part, post=post, job=tables | options, strict=strict, watch=stages.append)
    return result, stages.count("checking")


def map_skipped(result: Result) -> dict[str, str]:
    """The reason for each path that is left out, by its id."""
    return {
        note.what.rpartition("path ")[2]: note.why
        for note in result.notes
        if note.kind == "skipped"
    }


def write_holes(folder: Path, positions: Iterable[tuple[float, float]]) -> Path:
    """Write a drawing with circles of radius 2 mm."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    for x, y in positions:
        document.modelspace().add_circle((x, y), 2.0)
    document.saveas(folder / "holes.dxf")
    return folder / "holes.dxf"


def test_a_path_out_of_reach_is_left_out_alone() -> None:
    result, checks = build_counted(cell=FAR, **TRACE)
    assert list(map_skipped(result)) == ["c1"]
    assert "out of reach by" in map_skipped(result)["c1"]
    assert {path.id for path in result.tour.paths} == {"c2", "c3", "c4"}
    assert checks == 2
    assert any("c1" in str(line) and "out of reach" in str(line) for line in result.report["notes"])
    assert b"out of reach by" in camgen.preview(result, ".html")


def test_the_program_has_no_motions_of_a_path_that_is_left_out() -> None:
    """Its lead-ins, passes and tabs are left out as well."""
    operation: dict[str, Any] = {
        "kind": "follow",
        "depth": 4.0,
        "passes": 2,
        "lead_in": 3.0,
        "lead_out": 3.0,
        "tabs": 2,
    }
    result, _ = build_counted(cell=FAR, operation=operation)
    assert list(map_skipped(result)) == ["c1"]
    assert {origin.id for origin in result.program.paths} == {"c2", "c3", "c4"}
    ends = result.program.columns.ends
    ends = ends[np.isfinite(ends[:, 0])]
    low, high = ends[:, :2].min(axis=0), ends[:, :2].max(axis=0)
    outline = next(contour for contour in result.part.contours if contour.id == "c1").points
    assert (low > outline.min(axis=0)).all()
    assert (high < outline.max(axis=0)).all()
    whole, _ = build_counted(cell=NEAR, operation=operation)
    assert any("tab" in note.what and "c1" in note.what for note in whole.notes)
    assert not any("tab" in note.what and "c1" in note.what for note in result.notes)


def test_many_paths_out_of_reach_are_found_in_one_check(tmp_path: Path) -> None:
    holes = write_holes(tmp_path, product(np.arange(0, 980, 70.0).tolist(), repeat=2))
    cell = {"robot": "IRB 1200", "base_from_work": [300, -500, 0, 0, 0, 0]}
    drill = {"operation": {"kind": "drill"}, "tour": {"method": "nearest"}}
    result, checks = build_counted(holes, cell=cell, **drill)
    assert len(map_skipped(result)) > 60
    assert len(result.tour.paths) + len(map_skipped(result)) == 196
    assert checks <= 3
    shortfalls = {
        name: float(why.split("by ")[1].split(" mm")[0])
        for name, why in map_skipped(result).items()
    }
    assert all(amount > 0 for amount in shortfalls.values())


def test_paths_out_of_reach_of_an_arm_without_a_closed_form_are_left_out(tmp_path: Path) -> None:
    robot = Path(__file__).parents[2] / "fixtures" / "robots" / "cobot.urdf"
    holes = write_holes(
        tmp_path, [(0.0, 0.0), (2000.0, 0.0), (40.0, 0.0), (0.0, 2000.0), (0.0, 40.0)]
    )
    cell = {
        "robot": str(robot),
        "base_from_work": [400, -50, 0, 0, 0, 0],
        "home": [0, -90, 90, -90, -90, 0],
    }
    result, checks = build_counted(holes, cell=cell, operation={"kind": "drill"})
    assert set(map_skipped(result)) == {"c2", "c4"}
    assert checks == 2


def test_a_path_that_collides_is_left_out_alone() -> None:
    cell = {**NEAR, "fixtures": [[60, 5, -5, 75, 25, 60]]}
    result, _ = build_counted(cell=cell, **TRACE)
    assert set(map_skipped(result)) == {"c1", "c3"}
    assert all("tool against fixture 1" in why for why in map_skipped(result).values())
    assert {path.id for path in result.tour.paths} == {"c2", "c4"}


WALL = {**NEAR, "fixtures": [[48, -80, -5, 52, 140, 45]]}


def test_a_wall_across_the_links_costs_no_path(tmp_path: Path) -> None:
    """Holes are on both sides. Straight links through it collide, joint motions pass over it."""
    holes = write_holes(tmp_path, product((0.0, 100.0), (0.0, 30.0, 60.0)))
    tool = {"kind": "pen"}
    result, checks = build_counted(
        holes, strict=True, cell=WALL, operation={"kind": "drill"}, tool=tool
    )
    assert map_skipped(result) == {}
    assert len(result.tour.paths) == 6
    assert isinstance(result.tour, ArmTour)
    assert all((turns == 0).all() for turns in result.tour.rolls)
    assert checks == 2
    assert any("links between the paths" in note.what for note in result.notes)
    free, _ = build_counted(holes, cell=NEAR, operation={"kind": "drill"})
    assert not isinstance(free.tour, ArmTour)


def test_a_part_without_a_path_in_reach_is_refused_with_the_first_reason() -> None:
    far = {**FAR, "base_from_work": [1300, -60, 0, 0, 0, 0]}
    stages: list[str] = []
    with pytest.raises(
        NoSafeProgram, match=r"IRB 1200 cannot run path c\d at .* out of reach by .*base_from_work$"
    ):
        camgen.build(
            PARTS / "bracket.dxf", post="rapid", job={"cell": far, **TRACE}, watch=stages.append
        )
    assert stages.count("checking") == 1


def test_a_path_that_is_left_out_is_an_error_with_strict() -> None:
    with pytest.raises(
        NoSafeProgram, match=r"--strict and 1 left out, first: path c1 \(out of reach by"
    ) as refused:
        build_counted(strict=True, cell=FAR, **TRACE)
    assert refused.value.exit_code == 3


def test_the_command_line_names_a_path_left_out_and_writes_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["build", str(PARTS / "bracket.dxf"), "--post", "rapid", "-o", str(tmp_path / "b.mod")]
    words += ["--set", "cell.robot=IRB 1200", "--set", "cell.base_from_work=[800,-60,0,0,0,0]"]
    words += ["--set", "operation.kind=trace"]
    assert main(words) == 0
    messages = capsys.readouterr().err
    assert "path c1" in messages
    assert "out of reach by" in messages
    assert (tmp_path / "b.mod").exists()


TOOLS = [
    {"name": "short", "number": 1, "diameter": 4.0, "length": 60.0},
    {"name": "long", "number": 2, "diameter": 4.0, "length": 60.5},
]


def operations(*rows: dict[str, Any]) -> dict[str, Any]:
    """The tables of a job with two tools."""
    return {"tools": TOOLS, "operations": list(rows)}


def test_an_operation_loses_its_paths_out_of_reach_alone() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1", "c2"]},
        {"kind": "trace", "tool": 2, "ids": ["c3", "c4"]},
    )
    result, _ = build_counted(cell={**FAR, "base_from_work": [800, -60, 60, 0, 0, 0]}, **rows)
    assert "0:c1" in map_skipped(result)
    assert {path.id for path in result.tour.paths} == {"0:c2", "1:c3", "1:c4"} - set(
        map_skipped(result)
    )
    skipped = next(note for note in result.notes if note.kind == "skipped" and "0:c1" in note.ids)
    assert skipped.what == "operation 0 (trace): path 0:c1"
    assert "c1" in skipped.ids
    assert isinstance(result.tour, JobTour)


def test_a_tool_without_a_path_in_reach_is_not_changed_to() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1"]},
        {"kind": "trace", "tool": 2, "ids": ["c2", "c4"]},
    )
    whole, _ = build_counted(cell=NEAR, **rows)
    assert len(whole.counts) == 2
    result, _ = build_counted(cell=FAR, **rows)
    assert list(map_skipped(result)) == ["0:c1"]
    assert len(result.counts) == 1
    changes = [item for item in result.program.body if isinstance(item, ToolChange)]
    assert all(change.number == 2 for change in changes)


def test_a_path_has_its_clearance_in_the_report_whichever_tool_runs_it() -> None:
    """The fixture ends 12 mm before the drawing. The hole c2 begins 11 mm beyond its edge, and the
    tool of 4 mm is 2 mm nearer: 21 mm. The outline c1 is 10 mm away.
    """
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1"]},
        {"kind": "trace", "tool": 2, "ids": ["c2"]},
    )
    cell = {**NEAR, "margin": 30.0, "fixtures": [[-40, -40, 0, -12, 40, 30]]}
    result, _ = build_counted(cell=cell, **rows)
    assert len(result.counts) == 2
    paths = result.report["paths"]
    assert isinstance(paths, list)
    assert [(row["id"], row["clearance_mm"]) for row in paths] == [("0:c1", 10.0), ("1:c2", 21.0)]


def test_paths_out_of_reach_of_several_tools_are_found_in_one_check() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1", "c2"]},
        {"kind": "trace", "tool": 2, "ids": ["c1", "c4"]},
    )
    result, checks = build_counted(cell=FAR, **rows)
    assert set(map_skipped(result)) == {"0:c1", "1:c1"}
    assert checks == 2


def test_a_finishing_pass_is_left_out_with_its_roughing_pass() -> None:
    """Alone it would remove the material of all passes at once."""
    job = {"operation": {"kind": "follow", "depth": 6.0, "passes": 3, "finish": 0.5}}
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), job)
    remaining = leave_out_paths(planned, {"c1": "it collides"})
    assert {path.id for path in planned.paths} - {path.id for path in remaining.paths} == {
        "c1",
        "c1.finish",
    }
    why = next(note.why for note in remaining.notes if "c1.finish" in note.ids)
    assert why == "path c1, which takes material away before it, is left out"
    assert find_dependent(planned, {"c1.finish"}) == {}
    assert find_dependent(planned, {"c2"}).keys() == {"c2.finish"}


def test_a_later_operation_does_not_cut_material_that_a_skipped_one_left() -> None:
    rows = operations(
        {"kind": "pocket", "tool": 1, "ids": ["c3"], "depth": 4.0},
        {"kind": "follow", "tool": 2, "ids": ["c3", "c2"], "side": "inside", "depth": 4.0},
        {"kind": "trace", "tool": 2, "ids": ["c3"]},
    )
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), rows)
    opening = [path.id for path in planned.paths if path.id.startswith("0:")]
    assert find_dependent(planned, set(opening)).keys() == {"1:c3"}
    remaining = leave_out_paths(planned, dict.fromkeys(opening, "it collides"))
    assert {path.id for path in remaining.paths} == {"1:c2", "2:c3"}


def test_the_stock_proof_reports_the_material_of_paths_left_out() -> None:
    cut = {"kind": "follow", "depth": 2.0}
    stock = {"thickness": 2.0, "margin": 10.0}
    result, _ = build_counted(cell=FAR, operation=cut, stock=stock, tool={"diameter": 4.0})
    assert list(map_skipped(result)) == ["c1"]
    assert result.proof is not None
    assert result.proof.excess == pytest.approx(0.0, abs=0.5)
    outline = next(contour for contour in result.part.contours if contour.id == "c1")
    sides = np.diff(outline.points[[*range(len(outline.points)), 0]], axis=0)
    kerf = float(np.linalg.norm(sides, axis=1).sum()) * 4.0
    untaken = result.proof.levels[-1].excess.untaken
    assert untaken == pytest.approx(kerf, rel=0.15)
    assert any(
        "mm2 of paths that are left out" in text for _, text, _ in rows_of_build(result.proof)
    )


def test_a_recorded_program_out_of_reach_is_refused_as_a_whole(tmp_path: Path) -> None:
    """Later motions depend on earlier ones: on the material that they remove and where they end."""
    (tmp_path / "old.nc").write_text(
        "G21 G90\nG0 Z10\nG0 X0 Y0\nG1 Z0 F300\nG1 X900\nG0 Z10\nG0 X20 Y20\n"
        "G1 Z0\nX30\nG0 Z10\nM2\n"
    )
    with pytest.raises(NoSafeProgram, match="IRB 1200 cannot run"):
        camgen.build(tmp_path / "old.nc", post="rapid", job={"cell": NEAR})


def test_a_home_that_collides_is_refused() -> None:
    """The flange is at 522 0 848 mm at home, where a box is; the work begins at 450 -60 0."""
    box = [50, 40, 830, 90, 80, 870]
    with pytest.raises(NoSafeProgram, match=r"collides on .* give another home: cell\.home"):
        build_counted(cell={**NEAR, "fixtures": [box]}, tour={"method": "nearest"}, **TRACE)


def test_the_coverage_of_a_fill_with_paths_left_out_is_not_reported() -> None:
    cell = {"robot": "IRB 1200", "base_from_work": [860, -60, 0, 0, 0, 0]}
    result, _ = build_counted(PARTS / "copper.dxf", cell=cell, operation={"kind": "fill"})
    assert map_skipped(result)
    assert result.coverage is None
    assert any(note.what == "the coverage is not reported" for note in result.notes)


def test_attempts_of_a_build_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check blocks another path each time, and a build makes at most 16 attempts."""
    holes = write_holes(tmp_path, product((0.0, 10.0, 20.0, 30.0, 40.0), (0.0, 10.0, 20.0, 30.0)))
    first_paths: list[str] = []

    def check(program: Program, *_: object) -> None:
        first_paths.append(program.paths[0].id)
        raise Blocked(
            "holes.dxf", "it collides", "", "", (BlockedPath(0, "collision", "a collision"),)
        )

    monkeypatch.setattr(programs, "check", check)
    with pytest.raises(Blocked):
        build_counted(holes, cell=NEAR, operation={"kind": "drill"}, tour={"method": "nearest"})
    assert len(set(first_paths)) == len(first_paths)
    assert 1 < len(first_paths) <= 16


@pytest.mark.parametrize(
    ("post", "robot", "x"), [("pacscript", "VS-060", 520), ("vplus", "Cobra s600", 520)]
)
def test_programs_of_other_controllers_have_the_other_paths(
    post: str, robot: str, x: float
) -> None:
    result, _ = build_counted(
        post=post,
        cell={
            "robot": robot,
            "base_from_work": [x, -60 if post == "pacscript" else 0, 100, 0, 0, 0],
        },
        **TRACE,
    )
    assert list(map_skipped(result)) == ["c1"]
    assert {path.id for path in result.tour.paths} == {"c2", "c3", "c4"}
    assert result.deviation.max_mm < 0.01
