"""The proof of edges that are worked in pieces: notes have to name each stretch left out."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.check.proof import prove_motion
from camgen.check.proof.space import arc_points, chain_of, distances, refine
from camgen.model.part import Note
from camgen.pipeline import Result
from tests.support.sabotage import module

PARTS = Path(__file__).parents[3] / "fixtures" / "parts"
#: The second part on its own table: the lower ends of its uprights cannot be worked.
JOB = {
    "input": {"select": "e1, e24"},
    "operation": {"offset": 2},
    "tool": {"holder": [[-35, -35, 0, 35, 35, 100]], "axis_tilt": 15, "symmetric": True},
    "cell": {
        "robot": "IRB 2400",
        "base_from_work": [900, -75, 600, 0, 0, 0],
        "flange_from_tool": [-103.923, 0, 160, 0, -60, 0],
        "fixtures": [[-100, -100, -20, 300, 250, -0.5]],
    },
}


@pytest.fixture(scope="module")
def proven() -> tuple[Result, dict[str, Any]]:
    """A build, and the arguments of its proof."""
    arguments: dict[str, Any] = {}

    def record(part: Any, job: Any, programs: Any, notes: Any, *others: Any) -> Any:
        arguments.update(part=part, job=job, programs=programs, notes=notes, others=others)
        return prove_motion(part, job, programs, notes, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module("check.proof"), "prove_motion", record)
        return camgen.build(PARTS / "rfa2.stl", post="rapid", job=JOB), arguments


def find_skipped(notes: Sequence[Note]) -> Note:
    """The only note about a skipped stretch."""
    (note,) = (note for note in notes if note.kind == "skipped")
    return note


def test_the_proven_length_is_that_of_the_pieces(proven: tuple[Result, dict[str, Any]]) -> None:
    """Edge e1 is 200 mm long and e24 is 55 mm long."""
    result, given = proven
    motion, note = result.motion, find_skipped(given["notes"])
    assert motion is not None
    assert (motion.findings, motion.contours) == ((), 2)
    assert note.ids == ("e24",)
    # The tool covers the edge up to 0.45 mm beyond the end of its path, within the tolerance.
    assert motion.length == pytest.approx(200 + 55 - note.length, abs=0.75)


@pytest.mark.parametrize(
    ("length", "expected"),
    [(1.0, "mm are left out, notes say 1.0 mm"), (0.0, "e24 is not worked at"), (100.0, "")],
)
def test_a_gap_that_is_not_noted_is_found(
    proven: tuple[Result, dict[str, Any]], length: float, expected: str
) -> None:
    """The text is unchanged, and the note gets another length."""
    _, given = proven
    note = find_skipped(given["notes"])
    notes = [replace(item, length=length) if item is note else item for item in given["notes"]]
    motion = prove_motion(given["part"], given["job"], given["programs"], notes, *given["others"])
    findings = "; ".join(finding.text for _, finding in motion.findings)
    assert expected in findings
    assert bool(findings) is bool(expected)


def test_an_edge_that_starts_at_joint_values_may_be_shorter_than_the_trim() -> None:
    """After a trim of 100 mm at both ends nothing of the edge is left to examine."""
    job = tomllib.loads((PARTS / "rfa1_nominal.toml").read_text())
    job["operation"] = {**job["operation"], "trim": 100.0}
    motion = camgen.build(PARTS / "rfa1.stl", post="rapid", job=job).motion
    assert motion is not None
    assert motion.findings == ()
    assert any("it is given by joint values" in reason for reason in motion.unproven)


def test_points_of_a_refined_chain_are_near_each_other_and_on_it() -> None:
    chain = np.array([[0.0, 0, 0], [10, 0, 0], [10, 3, 0]])
    fine = refine(chain, 0.25)
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).max() <= 0.25 + 1e-9
    assert {tuple(point) for point in chain.tolist()} <= {tuple(point) for point in fine.tolist()}
    assert ((fine[:, 1] == 0) | (fine[:, 0] == 10)).all()


@pytest.mark.parametrize("radius", [0.5, 72.5, 150.0, 1000.0])
def test_an_arc_from_any_place_of_a_circle_lies_on_its_edge(radius: float) -> None:
    """The circle is two halves in the part, and the path runs 100 deg of it, in one arc."""

    def place(*degrees: float) -> np.ndarray:
        angles = np.radians(degrees)
        return radius * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])

    edge = chain_of(place(0, 180, 360), place(90, 270))
    arc = arc_points(*place(31, 81, 131))
    assert distances(arc, edge).max() < 0.0006 + 1e-8 * radius
    assert distances(arc * (1 + 0.05 / radius), edge).min() > 0.048


def test_a_huge_circle_does_not_fill_the_memory() -> None:
    """A via point 0.01 mm off the middle of 100 mm: radius 125 m; and a circle of 1000 km."""
    flat = arc_points(*np.array([[0.0, 0, 0], [50, 0.01, 0], [100, 0, 0]]))
    assert len(flat) < 100
    assert flat[:, 1].max() == pytest.approx(0.01, abs=1e-6)
    assert len(arc_points(*1e9 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, 0]]))) == 2000
