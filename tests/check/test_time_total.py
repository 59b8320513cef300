"""The time of whole programs: by path, on links, and as a build reports it."""

import math
import re
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.check.time import compute_cycle
from camgen.cli import main
from camgen.lower import lower
from camgen.model.cell import Dynamics
from camgen.model.job import Job
from camgen.model.path import ToolPath, Tour, make_waypoints
from camgen.model.pose import TOOL_DOWN, Pose, frozen, translation
from camgen.model.program import (
    Comment,
    Instruction,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Program,
    Wait,
    switch_off_first,
)
from camgen.post.plugins import find_post

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
PACE = Dynamics(acceleration=1000.0)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def make_tool_path(
    ident: str, points: list[tuple[float, float]], depths: tuple[float, ...] = (0.0,)
) -> ToolPath:
    n = len(points)
    position = frozen(np.column_stack([np.array(points, float), np.zeros(n)]))
    return ToolPath(
        ident,
        "cut",
        make_waypoints(position, np.nan, 10.0),
        closed=False,
        depths=depths,
    )


def test_a_time_belongs_to_its_path_or_to_the_link_to_it() -> None:
    body: tuple[Instruction, ...] = (
        MoveJ(make_pose(0, 0, 10), 100.0),
        Wait(0.25),  # travel: it is before the first path
        MoveL(make_pose(0, 0), 10.0, path=0),
        Output("process", 1.0),
        Wait(0.5),  # on the path: the signal is on
        MoveL(make_pose(50, 0), 10.0, path=0, work=True),
        Output("process", 0.0),
        Comment("path b"),
        MoveL(make_pose(50, 40), 100.0, path=1),
        Output("process", 1.0),
        Wait(0.5),
        MoveL(make_pose(0, 40), 10.0, path=1, work=True),
        Output("process", 0.0),
        MoveJ(make_pose(0, 40, 10), 100.0),
    )
    frame = translation(0, 0, 0)
    program = Program("p", frame, frame, switch_off_first(body), paths=(Origin("a"), Origin("b")))
    cycle = compute_cycle(program, PACE)
    work, plunge = 50 / 10 + 10 / 1000, 10 / 10 + 10 / 1000
    link, back = 40 / 100 + 100 / 1000, 2 * math.sqrt(10 / 1000)
    assert cycle.paths.tolist() == pytest.approx([work + 0.5, work + 0.5])
    assert cycle.links.tolist() == pytest.approx([0.25 + plunge, link])
    assert cycle.travel == pytest.approx(0.25 + plunge + link + back)
    assert cycle.total == pytest.approx(2 * (work + 0.5) + cycle.travel)


def test_passes_are_work_on_their_path_and_links_are_not() -> None:
    paths = (
        make_tool_path("a", [(0, 0), (10, 0), (20, 0)], (1.0, 2.0)),
        make_tool_path("b", [(5, 9), (6, 9)]),
    )
    program = lower(Tour(paths, 0.0, "as drawn"), find_post("gcode").cell(), Job(), "p", ())
    ends, owner, works = program.columns.ends, program.columns.path, program.columns.works
    assert [origin.id for origin in program.paths] == ["a", "b"]
    assert ends[works & (owner == 0)].tolist() == [
        [10, 0, -1],
        [20, 0, -1],
        [10, 0, -2],
        [0, 0, -2],
    ]
    assert ends[works & (owner == 1)].tolist() == [[6, 9, 0]]
    # First from home, then each path with the link to it, then back to home.
    assert [k for k, _ in groupby(owner.tolist())] == [-1, 0, 1, -1]


@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus", "gcode", "grbl"])
def test_the_times_of_a_build_add_up(post: str) -> None:
    result = camgen.build(BRACKET, post=post)
    cycle, report = result.cycle, result.report
    feed_time = result.motions.seconds
    assert feed_time * (1 - 1e-9) <= cycle.total < 2 * feed_time
    assert math.fsum(cycle.paths.tolist()) + cycle.travel == pytest.approx(cycle.total)
    assert (cycle.paths > 0).all()
    assert (cycle.links > 0).all()
    assert math.fsum(cycle.links.tolist()) < cycle.travel  # the link to home belongs to no path
    assert report["time_s"] == pytest.approx(cycle.total, abs=0.06)
    assert report["travel_s"] == pytest.approx(cycle.travel, abs=0.06)
    assert [path["time_s"] for path in report["paths"]] == pytest.approx(
        cycle.paths.tolist(), abs=0.006
    )  # type: ignore[attr-defined]


def test_each_path_takes_at_least_its_length_at_its_feed() -> None:
    paths = camgen.build(BRACKET, post="rapid").report["paths"]
    assert len(paths) == 4  # type: ignore[arg-type]
    for path in paths:  # type: ignore[attr-defined]
        assert path["time_s"] >= path["length_mm"] / path["feed"] - 0.006


def test_the_acceleration_of_the_job_changes_the_time_and_no_motion() -> None:
    slow, fast = (
        camgen.build(BRACKET, post="gcode", job={"process": {"acceleration": a}})
        for a in (50.0, 50_000.0)
    )
    assert slow.cycle.total > 1.2 * fast.cycle.total
    assert fast.cycle.total == pytest.approx(fast.motions.seconds, rel=0.01)
    lines = []
    for result in (slow, fast):
        lines.append([line for line in result.text.splitlines() if not line.startswith("(")])
    assert lines[0] == lines[1]


def test_the_acceleration_in_percent_changes_the_time_of_pacscript() -> None:
    slow, fast = (
        camgen.build(BRACKET, post="pacscript", job={"post": {"accel": a}}).cycle.total
        for a in (1.0, 100.0)
    )
    assert slow > fast


def test_the_time_of_edges_includes_the_joints_of_the_arm() -> None:
    part = BRACKET.with_name("rfa1.stl")
    result = camgen.build(part, post="rapid")
    assert result.reach is not None
    assert result.cycle.total > result.motions.seconds
    assert (result.cycle.paths > 0).all()


def test_the_summary_states_time_and_travel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", str(BRACKET), "--post", "gcode", "-o", str(tmp_path / "b.ngc")]) == 0
    line = next(row for row in capsys.readouterr().err.splitlines() if row.startswith("time"))
    assert re.fullmatch(r"time +about \d+ s, [\d.]+ s of it travel", line)
