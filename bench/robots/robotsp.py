"""RoboTSP's task: a VS-060 drills an aeroplane panel, beside the published figures.

    python -m bench.robots.robotsp FOLDER [SIZE ...]   all six sizes, or those named
    python -m bench.robots.robotsp made                twelve holes of a panel, without data

245 holes, the drill's axis as given, any turn about it, from home and back (Suarez-Ruiz, Lembono,
Pham, "RoboTSP", ICRA 2018). ``FOLDER`` holds the holes (``targets.csv``), the jig (``jig.stl``) and
the results (``published.json``). Each size is an ordinary build of a drawing: RAPID and PacScript,
read back, every motion tested against the arm itself, the tool, the panel, the jig and the
pedestal. Cylinders are three boxes each, which hold them and reach 22 % beyond.

The columns:

- cost: sum over the tour of the largest |dq| / v of the joints, as published
- execution: time of the same motions from rest to rest with their speeds and accelerations, all
  joints together
- seconds: time of the build by the clock, and of the processor, which other work changes less

Exits with 1 if a hole is left out or a tip is off.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import trimesh

import camgen
from bench.support.runner import Cells, Missed, Scenario, run
from camgen.model.pose import FloatArray, compute_fixed_xyz, frozen, pose_from_values
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange

COLUMNS = (
    "holes | program | not reached | cost {:.1f} | execution, s {:.1f} | seconds {:.1f} "
    "| of the processor {:.1f} | RoboTSP: cost | GLKH: cost | execution, s | CPU s"
)
POSTS = ("rapid", "pacscript")
#: deg, rad/s, rad/s2.
HOME = [0.0, -20.0, 130.0, 0.0, 70.0, 0.0]
SPEEDS, GAINS = np.array([1, 0.7, 0.7, 1, 0.7, 1.57]), np.array([5, 4.25, 4.25, 5.25, 6, 8.0])
#: The tip of the drill in the frame of the flange, mm.
TIP = [0.0, 120.0, 161.55]
#: The tip stops before a hole: distance, mm.
STAND_OFF = np.array([10.0, 0.0, 0.0])
#: Place of the jig's file in the robot's base, mm.
JIG = np.array([260.0, -418.0, 92.34])
#: The work frame: its z is against the drill, its x along the base's y; its origin is before the
#: panel, which is at x = 570 mm.
AXES = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
ORIGIN = np.array([570.0, 0, 0]) - STAND_OFF
Corners = list[float]


def make_box(centre: Sequence[float], half: Sequence[float]) -> Corners:
    """Two corners of a box, mm."""
    return [*np.subtract(centre, half).tolist(), *np.add(centre, half).tolist()]


def bound_cylinder(x: float, y: float, radius: float, low: float, high: float) -> list[Corners]:
    """Three boxes that hold an upright cylinder."""
    side = math.sqrt(3) / 2
    boxes = []
    for a, b in ((1, 0.5), (0.5, 1), (side, side)):
        dx, dy = a * radius, b * radius
        boxes.append([x - dx, y - dy, low, x + dx, y + dy, high])
    return boxes


def make_holder() -> list[Corners]:
    """The coupling, the camera, and the drill down to its bit, at the flange."""
    return [
        make_box([-36.5, 0, 5], [65, 28, 5]),
        make_box([-73.5, 0, 62 - 20.8], [30, 105, 31.2]),
        make_box([0, 66.5, 17.5], [31.5, 95, 7.5]),
        *bound_cylinder(0, 120, 21.65, 10, 26),
        *bound_cylinder(0, 120, 21, 26, 69),
        *bound_cylinder(0, 120, 16, 69, 91),
        *bound_cylinder(0, 120, 33.15, -195, 5),
        *bound_cylinder(22.45, 120, 40.9, -195, 5),
    ]


def convert_to_work(points: FloatArray) -> FloatArray:
    """Points of the robot's base in the work frame."""
    return np.asarray((points - ORIGIN) @ AXES)


def make_fixture(centre: Sequence[float], half: Sequence[float]) -> Corners:
    """A box of the robot's base in the work frame."""
    corners = convert_to_work(np.reshape(make_box(centre, half), (2, 3)))
    return [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]


def make_job(jig: list[str]) -> dict[str, object]:
    """The job of every size."""
    angles = [math.degrees(angle) for angle in compute_fixed_xyz(frozen(AXES))]
    return {
        "operation": {"kind": "drill"},
        "tool": {"diameter": 10.0, "symmetric": True, "holder": make_holder()},
        "process": {"clearance": 0.0, "approach": 0.0, "travel": 5000.0, "signal": ""},
        "cell": {
            "robot": "VS-060",
            "base_from_work": [*ORIGIN.tolist(), *angles],
            "flange_from_tool": [*TIP, 0.0, 0.0, 0.0],
            "home": HOME,
            # As published: nothing may collide, and no distance is asked for.
            "margin": 0.0,
            "joint_speeds": np.degrees(SPEEDS).tolist(),
            "joint_accelerations": np.degrees(GAINS).tolist(),
            "fixtures": [
                make_fixture([-32.5, 0, -216], [150, 150, 210]),
                make_fixture([597, 0, 445], [27, 350, 350]),
                *jig,
            ],
        },
    }


def place_jig(source: Path, folder: Path) -> str:
    """The jig as a file in the work frame."""
    solid = camgen.read(source).solid
    vertices = convert_to_work(solid.vertices + JIG)
    file = folder / "jig.stl"
    trimesh.Trimesh(vertices, solid.faces, process=False).export(file)
    return str(file)


def draw(holes: FloatArray, folder: Path) -> Path:
    """The stand-off points as circles of a drawing."""
    document = ezdxf.new(units=ezdxf.units.MM)
    space = document.modelspace()
    for x, y, _ in convert_to_work(holes - STAND_OFF).tolist():
        space.add_circle((x, y), 5.0)
    file = folder / f"panel_{len(holes)}.dxf"
    document.saveas(file)
    return file


def make_holes() -> FloatArray:
    """Twelve holes of a panel, mm, robot base."""
    y, z = np.meshgrid([-75.0, -25, 25, 75], [370.0, 420, 470])
    return np.column_stack([np.full(12, 570.0), y.ravel(), z.ravel()])


def list_joints(result: camgen.Result) -> FloatArray:
    """The joint values (M, 6) at the ends of the motions."""
    moves = result.program.columns.moves
    return np.array([(move.joints or move.target).values for move in moves])


def measure(joints: FloatArray) -> tuple[float, float]:
    """The cost and the seconds of execution."""
    turns = np.abs(np.diff(joints, axis=0))
    ramps = 2 * np.sqrt(turns / GAINS)
    from_rest = np.where(turns * GAINS < SPEEDS**2, ramps, turns / SPEEDS + SPEEDS / GAINS)
    return float((turns / SPEEDS).max(axis=1).sum()), float(from_rest.max(axis=1).sum())


def count_missed(joints: FloatArray, holes: FloatArray) -> int:
    """Number of holes before which no motion ends, the tip within 0.01 mm, the axis along x."""
    rotation, origin = compute_flange(find_robot("VS-060"), joints)
    tips = origin + rotation @ pose_from_values([*TIP, 0, 0, 0]).origin
    drilled = tips[rotation[:, 0, 2] > 1 - 1e-9]
    distances = np.linalg.norm((holes - STAND_OFF)[:, None] - drilled[None], axis=2)
    return int((distances.min(axis=1, initial=math.inf) > 0.01).sum())


def drill(holes: FloatArray, jig: list[str], published: list[str], folder: Path) -> Iterator[Cells]:
    """A row for each post."""
    drawing = draw(holes, folder)
    for post in POSTS:
        start, used = time.perf_counter(), time.process_time()
        result = camgen.build(drawing, post=post, job=make_job(jig))
        seconds, used = time.perf_counter() - start, time.process_time() - used
        joints = list_joints(result)
        missed = str(count_missed(joints, holes))
        is_right = missed == "0" and result.deviation.max_mm < 0.01
        figures = *measure(joints), seconds, used, *published
        yield len(holes), post, missed if is_right else Missed(missed), *figures


def read_published(data: dict[str, Any], size: int) -> list[str]:
    """The published figures of a size: costs, the best execution, the planner's seconds."""
    column = data["number_of_targets"].index(size)
    tasks = [row["execution_s"][column] for row in data["robotsp_by_roll_step_deg"].values()]
    best_task = min(seconds for seconds in tasks if seconds is not None)
    methods = data["methods"]
    peers = [row["cspace_cost"] for name, row in methods.items() if name.startswith("GLKH")]
    costs = [row[column] for row in peers if row[column] is not None]
    robotsp = {name: row[column] for name, row in methods["RoboTSP"].items()}
    return [
        f"{robotsp['cspace_cost']:.1f}",
        f"{min(costs):.1f}" if costs else "-",
        f"{best_task:.1f} to {robotsp['execution_s']:.1f}",
        f"{robotsp['cpu_s']:.1f}",
    ]


def list_tasks(words: list[str], folder: Path) -> Iterator[tuple[FloatArray, list[str], list[str]]]:
    """Holes, jig and published figures of each size."""
    if words[:1] == ["made"]:
        yield make_holes(), [], ["-"] * 4
        return
    data = Path(words[0])
    published = json.loads((data / "published.json").read_text())
    holes = np.loadtxt(data / "targets.csv", delimiter=",")[:, :3] * 1000
    jig = [place_jig(data / "jig.stl", folder)]
    for size in map(int, words[1:] or published["number_of_targets"]):
        # All holes are in the order in which they are listed.
        chosen = np.arange(len(holes))
        if size < len(holes):
            chosen = published["subsets"][str(size)]
        yield holes[chosen], jig, read_published(published, size)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        tasks = ((*task, Path(folder)) for task in list_tasks(sys.argv[1:], Path(folder)))
        sys.exit(run(Scenario(COLUMNS, tasks, drill)))
