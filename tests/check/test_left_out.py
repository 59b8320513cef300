"""What an arm cannot run of a flat part is left out with its reason, and the rest is a program like any other."""

from collections.abc import Sequence
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


def built(
    part: Path = PARTS / "bracket.dxf", strict: bool = False, **tables: Any
) -> tuple[Result, int]:
    """The result, and how many programs were checked for it."""
    said: list[str] = []
    post = tables.pop("post", "rapid")
    # A tool without a mass is another reason for --strict.
    options = {"post": {"mass": 1.0}} if strict else {}
    result = camgen.build(part, post=post, job=tables | options, strict=strict, watch=said.append)
    return result, said.count("checking")


def lost(result: Result) -> dict[str, str]:
    return {
        note.what.rpartition("path ")[2]: note.why
        for note in result.notes
        if note.kind == "skipped"
    }


def grid(folder: Path, places: Sequence[tuple[float, float]]) -> Path:
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    for x, y in places:
        document.modelspace().add_circle((x, y), 2.0)
    document.saveas(folder / "holes.dxf")
    return folder / "holes.dxf"


def test_a_path_out_of_reach_costs_no_other_one() -> None:
    result, checks = built(cell=FAR, **TRACE)
    assert list(lost(result)) == ["c1"]
    assert "out of reach by" in lost(result)["c1"]
    assert {path.id for path in result.tour.paths} == {"c2", "c3", "c4"}
    assert checks == 2
    assert any("c1" in str(line) and "out of reach" in str(line) for line in result.report["notes"])
    assert b"out of reach by" in camgen.preview(result, ".html")


def test_what_is_left_is_the_program_of_a_part_without_it() -> None:
    """Leads, passes and tabs of what is left out are nowhere."""
    cut: dict[str, Any] = {
        "kind": "follow",
        "depth": 4.0,
        "passes": 2,
        "lead_in": 3.0,
        "lead_out": 3.0,
        "tabs": 2,
    }
    result, _ = built(cell=FAR, operation=cut)
    assert list(lost(result)) == ["c1"]
    assert {origin.id for origin in result.program.paths} == {"c2", "c3", "c4"}
    ends = result.program.columns.ends
    ends = ends[np.isfinite(ends[:, 0])]
    low, high = ends[:, :2].min(axis=0), ends[:, :2].max(axis=0)
    outline = next(c for c in result.part.contours if c.id == "c1").points
    assert (low > outline.min(axis=0)).all()
    assert (high < outline.max(axis=0)).all()
    whole, _ = built(cell=NEAR, operation=cut)
    assert any("tab" in note.what and "c1" in note.what for note in whole.notes)
    assert not any("tab" in note.what and "c1" in note.what for note in result.notes)


def test_very_many_are_found_in_one_check(tmp_path: Path) -> None:
    holes = grid(tmp_path, [(70.0 * i, 70.0 * k) for i in range(14) for k in range(14)])
    cell = {"robot": "IRB 1200", "base_from_work": [300, -500, 0, 0, 0, 0]}
    drill = {"operation": {"kind": "drill"}, "tour": {"method": "nearest"}}
    result, checks = built(holes, cell=cell, **drill)
    assert len(lost(result)) > 60
    assert len(result.tour.paths) + len(lost(result)) == 196
    assert checks <= 3
    far = {name: float(why.split("by ")[1].split(" mm")[0]) for name, why in lost(result).items()}
    assert all(amount > 0 for amount in far.values())


def test_an_arm_without_a_closed_form_finds_them_too(tmp_path: Path) -> None:
    robot = Path(__file__).parents[2] / "fixtures" / "robots" / "cobot.urdf"
    holes = grid(tmp_path, [(0.0, 0.0), (2000.0, 0.0), (40.0, 0.0), (0.0, 2000.0), (0.0, 40.0)])
    cell = {
        "robot": str(robot),
        "base_from_work": [400, -50, 0, 0, 0, 0],
        "home": [0, -90, 90, -90, -90, 0],
    }
    result, checks = built(holes, cell=cell, operation={"kind": "drill"})
    assert set(lost(result)) == {"c2", "c4"}
    assert checks == 2


def test_a_path_that_collides_costs_no_other_one() -> None:
    cell = {**NEAR, "fixtures": [[60, 5, -5, 75, 25, 60]]}
    result, _ = built(cell=cell, **TRACE)
    assert set(lost(result)) == {"c1", "c3"}
    assert all("tool against fixture 1" in why for why in lost(result).values())
    assert {path.id for path in result.tour.paths} == {"c2", "c4"}


WALL = {**NEAR, "fixtures": [[48, -80, -5, 52, 140, 45]]}


def test_a_wall_across_the_ways_costs_no_path(tmp_path: Path) -> None:
    """Holes on both sides of it: straight ways from side to side collide, those of the joints go over it."""
    holes = grid(tmp_path, [(x, y) for x in (0.0, 100.0) for y in (0.0, 30.0, 60.0)])
    tool = {"kind": "pen"}
    result, checks = built(holes, strict=True, cell=WALL, operation={"kind": "drill"}, tool=tool)
    assert lost(result) == {}
    assert len(result.tour.paths) == 6
    assert isinstance(result.tour, ArmTour)
    assert all((turns == 0).all() for turns in result.tour.rolls)
    assert checks == 2
    assert any("links between the paths" in note.what for note in result.notes)
    free, _ = built(holes, cell=NEAR, operation={"kind": "drill"})
    assert not isinstance(free.tour, ArmTour)


def test_without_a_path_left_the_reason_is_that_of_the_first() -> None:
    far = {**FAR, "base_from_work": [1300, -60, 0, 0, 0, 0]}
    said: list[str] = []
    with pytest.raises(
        NoSafeProgram, match=r"IRB 1200 cannot run path c\d at .* out of reach by .*base_from_work$"
    ):
        camgen.build(
            PARTS / "bracket.dxf", post="rapid", job={"cell": far, **TRACE}, watch=said.append
        )
    assert said.count("checking") == 1


def test_strict_refuses() -> None:
    with pytest.raises(
        NoSafeProgram, match=r"--strict and 1 left out, first: path c1 \(out of reach by"
    ) as refused:
        built(strict=True, cell=FAR, **TRACE)
    assert refused.value.exit_code == 3


def test_the_command_line_tells_it_and_writes_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["build", str(PARTS / "bracket.dxf"), "--post", "rapid", "-o", str(tmp_path / "b.mod")]
    words += ["--set", "cell.robot=IRB 1200", "--set", "cell.base_from_work=[800,-60,0,0,0,0]"]
    words += ["--set", "operation.kind=trace"]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "path c1" in said
    assert "out of reach by" in said
    assert (tmp_path / "b.mod").exists()


TOOLS = [
    {"name": "short", "number": 1, "diameter": 4.0, "length": 60.0},
    {"name": "long", "number": 2, "diameter": 4.0, "length": 60.5},
]


def operations(*rows: dict[str, Any]) -> dict[str, Any]:
    return {"tools": TOOLS, "operations": list(rows)}


def test_an_operation_loses_what_is_out_of_reach_and_no_more() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1", "c2"]},
        {"kind": "trace", "tool": 2, "ids": ["c3", "c4"]},
    )
    result, _ = built(cell={**FAR, "base_from_work": [800, -60, 60, 0, 0, 0]}, **rows)
    assert "0:c1" in lost(result)
    assert {path.id for path in result.tour.paths} == {"0:c2", "1:c3", "1:c4"} - set(lost(result))
    told = next(note for note in result.notes if note.kind == "skipped" and "0:c1" in note.ids)
    assert told.what == "operation 0 (trace): path 0:c1"
    assert "c1" in told.ids
    assert isinstance(result.tour, JobTour)


def test_a_tool_that_has_nothing_left_is_not_changed_to() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1"]},
        {"kind": "trace", "tool": 2, "ids": ["c2", "c4"]},
    )
    whole, _ = built(cell=NEAR, **rows)
    assert len(whole.counts) == 2
    result, _ = built(cell=FAR, **rows)
    assert list(lost(result)) == ["0:c1"]
    assert len(result.counts) == 1
    changes = [item for item in result.program.body if isinstance(item, ToolChange)]
    assert all(change.number == 2 for change in changes)


def test_what_several_tools_lose_is_found_in_one_check() -> None:
    rows = operations(
        {"kind": "trace", "tool": 1, "ids": ["c1", "c2"]},
        {"kind": "trace", "tool": 2, "ids": ["c1", "c4"]},
    )
    result, checks = built(cell=FAR, **rows)
    assert set(lost(result)) == {"0:c1", "1:c1"}
    assert checks == 2


def test_a_last_pass_is_not_run_where_the_rough_one_is_left_out() -> None:
    """It would take all the material at its whole depth."""
    job = {"operation": {"kind": "follow", "depth": 6.0, "passes": 3, "finish": 0.5}}
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), job)
    left = leave_out_paths(planned, {"c1": "it collides"})
    assert {path.id for path in planned.paths} - {path.id for path in left.paths} == {
        "c1",
        "c1.finish",
    }
    why = next(note.why for note in left.notes if "c1.finish" in note.ids)
    assert why == "path c1, which takes material away before it, is left out"
    assert find_dependent(planned, {"c1.finish"}) == {}
    assert find_dependent(planned, {"c2"}).keys() == {"c2.finish"}


def test_a_later_operation_does_not_cut_what_an_earlier_one_left() -> None:
    rows = operations(
        {"kind": "pocket", "tool": 1, "ids": ["c3"], "depth": 4.0},
        {"kind": "follow", "tool": 2, "ids": ["c3", "c2"], "side": "inside", "depth": 4.0},
        {"kind": "trace", "tool": 2, "ids": ["c3"]},
    )
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), rows)
    opening = [path.id for path in planned.paths if path.id.startswith("0:")]
    assert find_dependent(planned, set(opening)).keys() == {"1:c3"}
    left = leave_out_paths(planned, dict.fromkeys(opening, "it collides"))
    assert {path.id for path in left.paths} == {"1:c2", "2:c3"}


def test_the_stock_proof_tells_what_is_left_as_left() -> None:
    cut = {"kind": "follow", "depth": 2.0}
    result, _ = built(
        cell=FAR, operation=cut, stock={"thickness": 2.0, "margin": 10.0}, tool={"diameter": 4.0}
    )
    assert list(lost(result)) == ["c1"]
    assert result.proof is not None
    assert result.proof.excess == pytest.approx(0.0, abs=0.5)
    outline = next(c for c in result.part.contours if c.id == "c1")
    kerf = (
        float(
            np.linalg.norm(
                np.diff(outline.points[[*range(len(outline.points)), 0]], axis=0), axis=1
            ).sum()
        )
        * 4.0
    )
    untaken = result.proof.levels[-1].excess.untaken
    assert untaken == pytest.approx(kerf, rel=0.15)
    assert any(
        "mm2 of paths that are left out" in text for _, text, _ in rows_of_build(result.proof)
    )


def test_a_recorded_program_is_run_whole_or_not_at_all(tmp_path: Path) -> None:
    """What comes after a motion counts on it: material that it takes away, the place where it ends."""
    (tmp_path / "old.nc").write_text(
        "G21 G90\nG0 Z10\nG0 X0 Y0\nG1 Z0 F300\nG1 X900\nG0 Z10\nG0 X20 Y20\nG1 Z0\nX30\nG0 Z10\nM2\n"
    )
    with pytest.raises(NoSafeProgram, match="IRB 1200 cannot run"):
        camgen.build(tmp_path / "old.nc", post="rapid", job={"cell": NEAR})


def test_a_home_that_collides_costs_no_path() -> None:
    """The flange is at 522 0 848 mm there, the work begins at 450 -60 0."""
    box = [50, 40, 830, 90, 80, 870]
    with pytest.raises(NoSafeProgram, match=r"collides on .* give another home: cell\.home"):
        built(cell={**NEAR, "fixtures": [box]}, tour={"method": "nearest"}, **TRACE)


def test_a_fill_with_a_part_left_out_does_not_tell_its_coverage() -> None:
    cell = {"robot": "IRB 1200", "base_from_work": [860, -60, 0, 0, 0, 0]}
    result, _ = built(PARTS / "copper.dxf", cell=cell, operation={"kind": "fill"})
    assert lost(result)
    assert result.coverage is None
    assert any(note.what == "the coverage is not reported" for note in result.notes)


def test_rounds_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A check that finds another path each time does not keep a build going for as many rounds as there are paths."""
    holes = grid(tmp_path, [(10.0 * i, 10.0 * k) for i in range(5) for k in range(4)])
    asked: list[str] = []

    def check(program: Program, *_: object) -> None:
        asked.append(program.paths[0].id)
        raise Blocked(
            "holes.dxf", "it collides", "", "", (BlockedPath(0, "collision", "a collision"),)
        )

    monkeypatch.setattr(programs, "check", check)
    with pytest.raises(Blocked):
        built(holes, cell=NEAR, operation={"kind": "drill"}, tour={"method": "nearest"})
    assert len(set(asked)) == len(asked)
    assert 1 < len(asked) <= 16


@pytest.mark.parametrize(
    ("post", "robot", "away"), [("pacscript", "VS-060", 520), ("vplus", "Cobra s600", 520)]
)
def test_other_controllers_get_the_rest_too(post: str, robot: str, away: float) -> None:
    result, _ = built(
        post=post,
        cell={
            "robot": robot,
            "base_from_work": [away, -60 if post == "pacscript" else 0, 100, 0, 0, 0],
        },
        **TRACE,
    )
    assert list(lost(result)) == ["c1"]
    assert {path.id for path in result.tour.paths} == {"c2", "c3", "c4"}
    assert result.deviation.max_mm < 0.01
