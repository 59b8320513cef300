"""Remedies for edges that are left out: each remedy is applied and the edge is built with it."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import camgen
from camgen.model.job import Job
from camgen.motion.setup import EdgeMotion, UnreachableEdge
from camgen.plan.edges.remedy import find_remedies

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
CELL = {
    "robot": "IRB 2400",
    "base_from_work": [937.5, -47.5, 640, 0, 0, 0],
    "flange_from_tool": [-103.923, 0, 160, 0, -60, 0],
    "fixtures": [[-100, -100, -60, 225, 195, -40.5], str(PARTS / "rfa1_base.stl")],
}
HOLDER = [[-35, -35, 0, 35, 35, 100]]
SETTING = re.compile(r"(tool)\.(axis_tilt|symmetric) = (true|[0-9]+)")


def make_job(select: str, **tool: object) -> dict[str, dict[str, Any]]:
    job: dict[str, dict[str, Any]] = {
        "input": {"select": select},
        "operation": {"offset": 2},
        "cell": CELL,
    }
    return {**job, "tool": {"holder": HOLDER, **tool}}


def find_left_out(part: str, job: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Reason why an edge or a part of it is left out, by the id of the edge."""
    notes = camgen.build(PARTS / part, post="rapid", job=job).notes
    return {note.ids[0]: note.why for note in notes if note.kind == "skipped"}


def test_an_edge_is_reached_with_the_settings_of_its_remedy() -> None:
    """The bores of the block and one upright edge are out of reach without tilt and roll."""
    lost = find_left_out("rfa1.stl", make_job("e1, e12, e13, e15"))
    assert set(lost) == {"e12", "e13", "e15"}
    assert lost["e15"].endswith("; tool.symmetric = true reaches it")
    for name, why in lost.items():
        tool = {key: value == "true" or float(value) for _, key, value in SETTING.findall(why)}
        assert tool, why
        assert name not in find_left_out("rfa1.stl", make_job(f"e1, {name}", **tool))


def test_a_trim_changes_the_note_of_an_edge_and_not_its_motions() -> None:
    """The upright edge of the second part ends at the table."""
    cell = {
        **CELL,
        "base_from_work": [900, -75, 600, 0, 0, 0],
        "fixtures": [[-100, -100, -20, 300, 250, -0.5]],
    }
    job = {**make_job("e1, e24", axis_tilt=15, symmetric=True), "cell": cell}
    programs, kinds = [], []
    for trim in (0, 1, 10, 100):
        operation = {"offset": 2, "trim": trim}
        result = camgen.build(PARTS / "rfa2.stl", post="rapid", job={**job, "operation": operation})
        programs.append(result.program.body)
        (note,) = (note for note in result.notes if "e24" in note.ids)
        kinds.append(note.kind)
        if note.kind == "skipped":
            assert re.fullmatch(r"[0-9.]+ mm of edge e24", note.what)
            assert note.length == pytest.approx(float(note.what.split()[0]), abs=0.05)
        else:
            ends = re.search(r"without its first ([0-9.]+) and last ([0-9.]+) mm", note.what)
            assert ends
            assert sum(map(float, ends.groups())) == pytest.approx(5.0, abs=0.5)
    assert kinds == ["skipped", "skipped", "assumed", "assumed"]
    assert all(len(body) == len(programs[0]) for body in programs)


# -- without an arm --------------------------------------------------------------------


def reach_nothing(_: Job, names: Sequence[str]) -> list[EdgeMotion | UnreachableEdge]:
    return [UnreachableEdge(name, "limit", "beyond") for name in names]


def test_many_edges_are_counted_and_a_shape_is_not_tried() -> None:
    lost = [UnreachableEdge(f"e{k}", "limit", "beyond") for k in range(1, 12)]
    explained, notes = find_remedies(lost, camgen.job(), reach_nothing)
    assert [bool(edge.remedy) for edge in explained] == [True] * 8 + [False] * 3
    assert len(notes) == 1
    shape = [UnreachableEdge("e1", "shape", "its two faces are back to back")]
    assert find_remedies(shape, camgen.job(), reach_nothing) == (shape, [])
