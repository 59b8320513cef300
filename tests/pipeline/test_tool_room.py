"""Orientations of the tool at samples of edges, tested by points in the tool and in a plate."""

from itertools import product

import numpy as np
import pytest

from camgen.motion.pose_paths import PosePath
from camgen.pipeline import make_job_post
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import Case, Request, _mark, make_case
from camgen.pipeline.tool_room import Samples
from camgen.read.files import Files
from camgen.read.job_file import from_mapping
from tests.support.plate import PLATE_SIZE, write_plate

#: Shaft of 4 mm and 60 mm, then a holder of 60 x 60 x 40 mm.
TOOL = {
    "diameter": 4.0,
    "length": 100.0,
    "holder": [[-30, -30, 0, 30, 30, 40]],
    "symmetric": True,
    "axis_tilt": 15.0,
}
BOXES = [((-2, -2, -60), (2, 2, 0)), ((-30, -30, -100), (30, 30, -60))]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    plate = write_plate(tmp_path_factory.mktemp("room"))
    tables = {
        "input": {"select": "all"},
        "operation": {"offset": 2},
        "tool": TOOL,
        "cell": {"robot": "IRB 1200", "base_from_work": [500, 0, 100, 0, 0, 0]},
    }
    job = from_mapping(tables)
    read = read_inputs([plate], job, make_job_post("rapid", job, "job").cell(), Files())
    return make_case(read.part, job, read.cell, Request(plate, "rapid"))


def points_of_tool() -> np.ndarray:
    """Points of shaft and holder, in the frame of the tool, every 2 mm or less."""
    points = []
    for low, high in BOXES:
        steps = [np.linspace(a, b, int((b - a) / 2) + 1) for a, b in zip(low, high, strict=True)]
        points += list(product(*steps))
    return np.array(points)


def test_no_sampled_orientation_is_in_the_plate_or_in_the_table(case: Case) -> None:
    """The tool may enter the plate by its radius times the sine of the tilt, plus 0.1 mm."""
    allowed = 2 * np.sin(np.radians(15)) + 0.1 + 1e-6
    tool = points_of_tool()
    size = np.array(PLATE_SIZE)
    tested = 0
    for resting in case.resting_poses:
        assert resting.face is not None
        table = max(float(resting.face.normal @ corner) for corner in case.solid.vertices) + 0.5
        for owner, rotation in zip(resting.samples.owner, resting.samples.rotation, strict=True):
            points = resting.samples.position[owner] + tool @ rotation.T
            inside = ((points > allowed) & (points < size - allowed)).all(axis=1)
            assert not inside.any()
            assert (points @ resting.face.normal < table + 1e-6).all()
            tested += 1
    assert tested > 100


def test_edges_at_the_table_have_no_orientation_and_those_above_have_four(
    case: Case,
) -> None:
    """The tool would point up at an edge at the table, so that it would be in the table."""
    for resting in case.resting_poses[:2]:
        assert resting.face is not None
        counts = np.bincount(resting.samples.owner, minlength=len(resting.samples.position))
        depth = resting.samples.position @ resting.face.normal
        assert (counts[depth == depth.max()] == 0).all()
        assert (counts[depth == depth.min()] == 4).all()


def test_the_weights_of_the_samples_of_an_edge_add_up_to_one(case: Case) -> None:
    samples = case.resting_poses[0].samples
    assert np.allclose(samples.weights.sum(axis=0), 1)
    all_samples = np.ones((1, len(samples.position)), dtype=np.bool_)
    assert np.allclose(samples.sum_by_edge(all_samples), 1)


def test_fewer_samples_keep_their_first_orientations(case: Case) -> None:
    samples = case.resting_poses[0].samples
    fewer: Samples = samples.thin_out(len(samples.position) // 2, 1)
    assert len(fewer.position) == -(-len(samples.position) // 2)
    assert (np.bincount(fewer.owner) <= 1).all()
    first_rotations = samples.rotation[samples.starts]
    assert all((first_rotations == rotation).all(axis=(1, 2)).any() for rotation in fewer.rotation)


def test_marks_along_a_piece_are_worked() -> None:
    """A piece from 20 to 60 mm of 100 mm, and one that runs 2 mm beside the edge."""
    eye = np.broadcast_to(np.eye(3), (101, 3, 3))
    positions = np.column_stack([np.arange(101.0), np.zeros((101, 2))])
    edge = PosePath(positions, np.full((101, 3), np.nan), eye)

    def piece(start: float, end: float, aside: float) -> PosePath:
        ends = np.array([[start, aside, 0.0], [end, aside, 0.0]])
        return PosePath(ends, np.full((2, 3), np.nan), eye[:2])

    worked = _mark(edge, [piece(20, 60, 0)])
    assert np.flatnonzero(worked).tolist() == list(range(19, 61))
    assert not _mark(edge, [piece(20, 60, 2)]).any()
    assert _mark(edge, [piece(0, 55, 0), piece(100, 50, 0)]).all()
