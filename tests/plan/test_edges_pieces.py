"""The search for pieces: its limit, and its end by Ctrl-C."""

import tomllib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from bench.robots.rfa import PARTS
from camgen.model.part import Line
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import UnreachableEdge
from camgen.order import may_end_early
from camgen.plan import ignore_stages
from camgen.plan.edges.pieces import PieceSearch
from camgen.plan.edges.poses import make_poses
from tests.support.edge_shapes import straight

#: An edge of 50 mm has 11 stations, 5 mm apart.
STATIONS = 11


class EndedCoverage:
    """A coverage that finds one piece of each line and is interrupted at the line `ends_at`."""

    def __init__(self, ends_at: str = "") -> None:
        self.ends_at = ends_at

    def count_stations(self, _: PosePath) -> int:
        return STATIONS

    def find_pieces(self, line: Line, *_: Any) -> Any:
        if line.id == self.ends_at:
            raise KeyboardInterrupt
        return SimpleNamespace(motions=(f"{line.id}.1",), too_fast=0.0)


def search_edges(search: PieceSearch, coverage: Any) -> dict[str, Any]:
    edge = straight((0, 0, 0), (50, 0, 0), (0, 0, 1), (0, -1, 0))
    path = make_poses(edge, 1.0)
    assert isinstance(path, PosePath)
    names = ("e1", "e2", "e3", "e4")
    lines = [(replace(edge, id=name), path) for name in names]
    whole = [UnreachableEdge(name, "reach", "") for name in names]
    return search.find(lines, whole, coverage)


def test_ctrl_c_ends_the_search_and_not_the_build() -> None:
    stages: list[str] = []
    search = PieceSearch("edge", stages.append, 1000)
    assert list(search_edges(search, EndedCoverage("e3"))) == ["e1", "e2"]
    assert len(stages) == 3
    assert all(map(may_end_early, stages))
    (note,) = search.notes()
    assert note.ids == ("e3", "e4")
    assert "the search was ended" in note.why


def test_ctrl_c_ends_the_build_if_no_progress_is_shown() -> None:
    with pytest.raises(KeyboardInterrupt):
        search_edges(PieceSearch("edge", ignore_stages, 1000), EndedCoverage("e3"))


def test_edges_beyond_the_limit_of_stations_are_named() -> None:
    search = PieceSearch("edge", ignore_stages, 2 * STATIONS)
    assert list(search_edges(search, EndedCoverage())) == ["e1", "e2"]
    (note,) = search.notes()
    assert note.ids == ("e3", "e4")
    assert "limits.stations" in note.why


def test_the_reason_has_the_length_along_which_joints_are_too_slow() -> None:
    search = PieceSearch("edge", ignore_stages, 1000, too_fast={"e1": 12.34})
    slow, other = (UnreachableEdge(name, "limit", "axis 5", "turn it") for name in ("e1", "e2"))
    assert search.explain(other) is other
    reason = search.explain(slow).reason
    assert reason == "axis 5; the joints are too slow for process.feed along 12.3 mm of it; turn it"


@pytest.mark.parametrize(("stations", "is_sought"), [(5, False), (50_000, True)])
def test_the_job_sets_the_limit(stations: int, is_sought: bool) -> None:
    job = tomllib.loads((PARTS / "rfa1_nominal.toml").read_text())
    job["limits"] = {"stations": stations}
    result = camgen.build(PARTS / "rfa1.stl", post="rapid", job=job)
    pieces = [path.id for path in result.tour.paths if "." in path.id]
    assert bool(pieces) is is_sought
    assert any("limits.stations" in note.why for note in result.notes) is not is_sought
    worked = float(np.sum(result.tour.lengths))
    assert worked > 700.0
