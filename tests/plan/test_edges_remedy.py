"""What is said to help an edge that is left out does help: every remedy is applied and built."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

import camgen
from camgen.model.job import Job
from camgen.model.part import Edge
from camgen.motion.setup import EdgeMotion, UnreachableEdge
from camgen.plan.edges.remedy import Attempts, remedies
from tests.support.edge_shapes import rim, straight

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
CELL = {
    "robot": "IRB 2400",
    "base_from_work": [937.5, -47.5, 640, 0, 0, 0],
    "flange_from_tool": [-103.923, 0, 160, 0, -60, 0],
    "fixtures": [[-100, -100, -60, 225, 195, -40.5], str(PARTS / "rfa1_base.stl")],
}
HOLDER = [[-35, -35, 0, 35, 35, 100]]
SETTING = re.compile(r"(tool|operation)\.(axis_tilt|symmetric|trim) = (true|[0-9]+)")


def tables(select: str, **tool: object) -> dict[str, dict[str, Any]]:
    job: dict[str, dict[str, Any]] = {
        "input": {"select": select},
        "operation": {"offset": 2},
        "cell": CELL,
    }
    return {**job, "tool": {"holder": HOLDER, **tool}}


def left_out(part: str, job: dict[str, dict[str, Any]]) -> dict[str, str]:
    """By edge why it is left out."""
    notes = camgen.build(PARTS / part, post="rapid", job=job).notes
    return {note.ids[0]: note.why for note in notes if note.kind == "skipped"}


def test_the_settings_that_are_named_reach_the_edge() -> None:
    """Nominal, the block's bores and one upright edge are out of reach: two remedies of different kinds."""
    lost = left_out("rfa1.stl", tables("e1, e12, e13, e15"))
    assert set(lost) == {"e12", "e13", "e15"}
    assert lost["e15"].endswith("; tool.symmetric = true reaches it")
    for name, why in lost.items():
        tool = {key: value == "true" or float(value) for _, key, value in SETTING.findall(why)}
        assert tool, why
        assert name not in left_out("rfa1.stl", tables(f"e1, {name}", **tool))


def test_a_trim_that_is_named_leaves_out_what_is_said_and_a_smaller_one_does_not_help() -> None:
    """The upright edges of the second part end at its table."""
    cell = {
        **CELL,
        "base_from_work": [900, -75, 600, 0, 0, 0],
        "fixtures": [[-100, -100, -20, 300, 250, -0.5]],
    }
    job = {**tables("e1, e24", axis_tilt=15, symmetric=True), "cell": cell}
    stated = re.search(
        r"; operation\.trim = (\d+) reaches all but ([0-9.]+) mm$", left_out("rfa2.stl", job)["e24"]
    )
    assert stated
    trim, missing = int(stated[1]), float(stated[2])
    whys = {}
    for tried in (trim - 1, trim):
        result = camgen.build(
            PARTS / "rfa2.stl", post="rapid", job={**job, "operation": {"offset": 2, "trim": tried}}
        )
        whys[tried] = next(
            note.what for note in result.notes if note.kind == "skipped" and note.ids == ("e24",)
        )
    assert "line of 55 mm" in whys[trim - 1]  # left out whole
    ends = re.search(r"without its first ([0-9.]+) and last ([0-9.]+) mm", whys[trim])
    assert ends
    assert float(ends[1]) + float(ends[2]) == pytest.approx(missing)


# -- by rules alone --------------------------------------------------------------------------------------------------


def said(
    edges: Sequence[Edge], attempts: Attempts, job: Job | None = None
) -> tuple[list[str], int]:
    """What is told of edges that are lost, and how many notes there are."""
    lost = [UnreachableEdge(edge.id, "limit", "beyond") for edge in edges]
    told, notes = remedies(lost, {edge.id: edge for edge in edges}, job or camgen.job(), attempts)
    return [one.remedy for one in told], len(notes)


def nothing(_: Job, names: Sequence[str]) -> list[EdgeMotion | UnreachableEdge]:
    return [UnreachableEdge(name, "limit", "beyond") for name in names]


LINE = straight((0, 0, 0), (60, 0, 0), (0, 0, 1), (0, -1, 0))


@pytest.mark.parametrize(
    ("needs", "text"),
    [
        ((0.0, 7.0), "operation.trim = 8 reaches all but 8 mm"),
        ((2.5, 0.0), "operation.trim = 3 reaches all but 3 mm"),
        ((9.0, 11.0), "operation.trim = 12 reaches all but 24 mm"),
        ((0.0, 31.0), "helps: another place may"),  # more than half of it
        ((16.0, 16.0), "helps: another place may"),
    ],
)
@pytest.mark.parametrize("less", [0.0, 2.0, 100.0])
def test_the_least_trim_is_named(needs: tuple[float, float], text: str, less: float) -> None:
    """However much less it takes for the arm to stand at the ends."""
    asked: list[tuple[float, tuple[float, float]]] = []

    def stands(_: Job, left_out: Mapping[str, float], last: bool) -> list[bool]:
        return [mm >= needs[last] - less for mm in left_out.values()]

    def part(job: Job, ends: Mapping[str, tuple[float, float]]) -> list[bool]:
        asked.extend((job.tool.axis_tilt, one) for one in ends.values())
        return [low >= needs[0] and high >= needs[1] for low, high in ends.values()]

    ((told,), _) = said([LINE], Attempts(nothing, part, stands))
    assert text in told
    assert len(asked) == len(set(asked))
    assert less or all(ends[0] >= needs[0] and ends[1] >= needs[1] for _, ends in asked)


def never(_: Job, ends: Mapping[str, tuple[float, float]]) -> list[bool]:
    return [False] * len(ends)


def always(_: Job, left_out: Mapping[str, float], __: bool) -> list[bool]:
    return [True] * len(left_out)


def test_a_closed_edge_has_no_ends_to_trim() -> None:
    ((told,), _) = said([rim((0, 0, 0), 20, outer=True)], Attempts(nothing, never, always))
    assert "trim" in told
    assert "another place may" in told


def test_a_trim_is_named_with_the_freest_tool_where_it_does_not_help_alone() -> None:
    attempts = Attempts(
        nothing,
        lambda job, ends: [job.tool.symmetric and sum(one) >= 4 for one in ends.values()],
        always,
    )
    ((told,), _) = said([LINE], attempts)
    assert (
        told
        == "tool.axis_tilt = 30 with tool.symmetric = true and operation.trim = 4 reaches all but 4 mm"
    )


def test_many_edges_are_counted_and_a_shape_is_not_tried() -> None:
    edges = [straight((0, 0, 0), (60, 0, 0), (0, 0, 1), (0, -1, 0), f"e{k}") for k in range(1, 12)]
    told, notes = said(edges, Attempts(nothing, never, always))
    assert [bool(text) for text in told] == [True] * 8 + [False] * 3
    assert notes == 1
    shape = [UnreachableEdge("e1", "shape", "its two faces are back to back")]
    assert remedies(shape, {"e1": LINE}, camgen.job(), Attempts(nothing, never, always)) == (
        shape,
        [],
    )
