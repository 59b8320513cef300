"""The pose of a part in a scan, beside peers.

    python -m bench.read.localize [STARTS, 50] [STARTS of the peers, 3] [POINTS, 100000] [PART ...]

Scans of POINTS points with 0.1 mm noise of the fixtures rfa1 and rfa2, placed at random within 30
deg and 50 mm. Peers, where installed: GICP of small_gicp and ICP of trimesh, on points spread over
the model, from the same start. rfa2 looks the same after half a turn: the pose with the smaller
rotation is the true one. Exits with 1 if a full scan misses the goal.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np
import trimesh

from bench.support.runner import PARTS, Cells, Missed, Scenario, read_words, run
from bench.support.timing import timed
from camgen.localize import localize
from camgen.model.errors import CamgenError
from camgen.read.files import Files
from camgen.read.solid import mesh as solids
from tests.support.clouds import ASIDE, DOWN, ROUND, errors, placed, scan

NOISE = 0.1
MM_GOAL, DEG_GOAL = 0.02, 0.01
#: Views (None: all of the surface), share of points on the bench, and share of the starts.
SCANS = {
    "all of the surface": (None, 0.0, 1.0),
    "from above, 4 views, 20 % bench": (ROUND, 0.2, 1.0),
    "from above, 1 view aside, 20 % bench": (ASIDE, 0.2, 0.2),
    "straight down, 20 % bench": (DOWN, 0.2, 0.2),
}
COLUMNS = (
    "part | scan | method | found | mm at origin, max {:.4f} | mm at worst vertex, max {:.4f} "
    "| deg, max {:.4f} | s, median {:.1f}"
)
Array = np.ndarray
#: Finds the rotation and origin of the part from points of a scan.
Method = Callable[[Array], tuple[Array, Array]]
PATHS = {name: PARTS / f"{name}.stl" for name in ("rfa1", "rfa2")}


def make_camgen(name: str, _count: int) -> Method:
    surface, _ = solids.read_surface(Files().read(PATHS[name]))

    def find_pose(points: Array) -> tuple[Array, Array]:
        pose = localize("scan", (surface.vertices, surface.faces), points).base_from_work
        return np.asarray(pose.rotation), np.asarray(pose.origin)

    return find_pose


def _spread(name: str, count: int) -> Array:
    """Points over the surface of a part."""
    model = trimesh.load_mesh(PATHS[name])
    return np.asarray(trimesh.sample.sample_surface(model, count, seed=0)[0])


def make_gicp(name: str, count: int) -> Method:
    import small_gicp  # noqa: PLC0415 (a peer that need not be there)

    model = _spread(name, count)

    def find_pose(points: Array) -> tuple[Array, Array]:
        pose = np.eye(4)
        for reach, step in ((50.0, 2.0), (2.0, 0.5)):
            options = {"downsampling_resolution": step, "max_correspondence_distance": reach}
            options |= {"registration_type": "GICP", "num_threads": 1, "max_iterations": 100}
            pose = small_gicp.align(points, model, pose, **options).T_target_source
        return pose[:3, :3], pose[:3, 3]

    return find_pose


def make_icp(name: str, count: int) -> Method:
    model = _spread(name, count)

    def find_pose(points: Array) -> tuple[Array, Array]:
        # The scan moves onto the model. With a bench in it neither covers the other.
        options = {"max_iterations": 50, "reflection": False, "scale": False}
        pose = np.linalg.inv(trimesh.registration.icp(points, model, **options)[0])
        return pose[:3, :3], pose[:3, 3]

    return find_pose


def measure_starts(
    method: Method, part: trimesh.Trimesh, kind: str, starts: int, count: int
) -> list[tuple[float, ...]]:
    """The errors and seconds of each start with a result."""
    views, table, _ = SCANS[kind]
    rows = []
    for seed in range(starts):
        truth = placed(np.random.default_rng(1000 + seed), 30.0, 50.0)
        points = scan(part, count, seed, views, NOISE, table) @ truth[0].T + truth[1]
        try:
            pose, seconds = timed(partial(method, points))
        except CamgenError:
            continue
        rows.append((*errors(pose, truth, part.vertices), seconds))
    return rows


def list_methods() -> dict[str, Callable[[str, int], Method]]:
    """The methods that are installed."""
    methods = {"camgen": make_camgen}
    if importlib.util.find_spec("scipy"):  # which trimesh needs for it
        methods["trimesh ICP"] = make_icp
    if importlib.util.find_spec("small_gicp"):
        methods["small_gicp GICP"] = make_gicp
    return methods


def measure(name: str, kind: str, starts: int, fewer: int, points: int) -> Iterator[Cells]:
    """A row for each method.

    fewer: number of starts of the peers.
    points: number of points of a scan.
    """
    part = trimesh.load_mesh(PATHS[name])
    views, _, share = SCANS[kind]
    for label, make in list_methods().items():
        count = round(share * starts) if label == "camgen" else fewer
        rows = np.array(measure_starts(make(name, points), part, kind, count, points))
        good, figures = 0, [*"----"]
        if len(rows):
            good = int((rows[:, :3] < [MM_GOAL, MM_GOAL, DEG_GOAL]).all(axis=1).sum())
            figures = [*rows[:, :3].max(axis=0), np.median(rows[:, 3])]
        is_missed = label == "camgen" and views is None and good < count
        share_text = f"{good} of {count}"
        yield name, kind, label, Missed(share_text) if is_missed else share_text, *figures


if __name__ == "__main__":
    starts, fewer, points, *names = read_words(50, 3, 100_000)
    inputs = [(*pair, starts, fewer, points) for pair in product(names or PATHS, SCANS)]
    raise SystemExit(run(Scenario(COLUMNS, inputs, measure)))
