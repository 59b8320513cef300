"""A long program is examined in stretches, with the same result as the whole."""

from typing import Any

import numpy as np
import pytest

import camgen
from camgen.check.proof import travel
from camgen.check.proof.pieces import BLOCK, arcs_through
from camgen.model.errors import VerifyError
from camgen.model.job import ProcessTable
from camgen.model.part import ContourColumns, tabulate_contours
from tests.support.sabotage import PARTS, Patch, change_program, module, with_columns

JOB: dict[str, Any] = {
    "operation": {"depth": 3.0, "passes": 2, "lead_in": 2.0, "tabs": 2, "tab_height": 1.0},
    "process": {"spindle": 9000.0, "feed": 15.0},
    "tool": {"diameter": 3.0},
}
WHOLE, SHORT = 10**9, 1


def prove(patch: Patch, stretch: int, post: str, job: dict[str, Any] = JOB) -> Any:
    """The proof of a build that is examined in stretches of at least this many motions."""
    patch.setattr(travel, "_STRETCH", stretch)
    return camgen.build(PARTS / "motor.dxf", post=post, job=job).motion


def count_stretches(patch: Patch, post: str) -> int:
    """The number of stretches of a build."""
    counts = []
    original = travel.cut_at_clearance

    def counted(*given: Any) -> list[tuple[int, int]]:
        counts.append(len(original(*given)))
        return original(*given)

    patch.setattr(module("check.proof.flat"), "cut_at_clearance", counted)
    prove(patch, SHORT, post)
    return counts[0]


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_proof_in_stretches_equals_that_of_the_whole(post: str, monkeypatch: Patch) -> None:
    whole = prove(monkeypatch, WHOLE, post)
    assert prove(monkeypatch, SHORT, post) == whole
    # One stretch for each path, one before the first path and one after the last.
    assert count_stretches(monkeypatch, post) == whole.contours + 2


def test_a_fault_in_the_last_stretch_is_found_at_its_line(monkeypatch: Patch) -> None:
    def change(body: Any) -> Any:
        speed = np.array(body.packed.speed)
        works = np.flatnonzero(body.packed.work)
        speed[works[-3:]] *= 2
        return with_columns(body, speed=speed)

    change_program(monkeypatch, change)
    job = {"process": {"feed": 15.0}, "tool": {"diameter": 3.0}}
    errors = []
    for stretch in (WHOLE, SHORT):
        with pytest.raises(VerifyError, match="has a feed of") as caught:
            prove(monkeypatch, stretch, "gcode", job)
        errors.append(str(caught.value))
    assert errors[0] == errors[1]


class HighMotions:
    """Motions at a clearance of 20 mm, each with its path."""

    def __init__(self, path: list[int]) -> None:
        self.path = np.array(path)
        self.end = np.full((len(path), 3), 20.0)

    def __len__(self) -> int:
        return len(self.path)


def test_a_path_that_is_visited_twice_is_in_one_stretch(monkeypatch: Patch) -> None:
    monkeypatch.setattr(travel, "_STRETCH", SHORT)
    # Path 1 is visited again after path 2.
    motions = HighMotions([-1, 0, 0, 1, 1, 2, 2, 1, 3, -1])
    stretches = travel.cut_at_clearance(motions, ProcessTable(clearance=20.0), 1e-3)
    assert stretches == [(0, 1), (1, 3), (3, 8), (8, 9), (9, 10)]


def test_arcs_in_several_blocks_keep_their_values() -> None:
    # There are more arcs than in one block, and each has its own radius.
    count = BLOCK + 100
    radius = np.linspace(1.0, 2.0, count)
    start, end = np.column_stack([radius, 0 * radius]), np.column_stack([0 * radius, radius])
    via = radius[:, None] * np.sqrt([0.5, 0.5])

    pieces = arcs_through(start, end, np.zeros(count, np.intp), np.arange(count), via)
    assert np.allclose(pieces.radius, radius)
    assert np.allclose(pieces.centre, 0.0, atol=1e-12)
    assert np.allclose(pieces.half, np.pi / 4)
    assert (pieces.turn == 1).all()


def test_the_table_of_a_drawing_equals_that_of_its_contours() -> None:
    part = camgen.read(PARTS / "motor.dxf")
    joined: ContourColumns = tabulate_contours(list(part.contours))
    for expected, column in zip(tabulate_contours(part.contours), joined, strict=True):
        assert np.array_equal(expected, column)
