"""RoboTSP's task: a VS-060 drills an aeroplane panel, beside the published figures.

    python -m bench.robots.robotsp FOLDER [SIZE ...]   all six sizes, or those named
    python -m bench.robots.robotsp made                twelve holes of a panel, without data

245 holes, the drill's axis as given, any turn about it, from home and back (Suarez-Ruiz, Lembono, Pham, "RoboTSP", ICRA
2018). ``FOLDER`` holds the holes (``targets.csv``), the jig (``jig.stl``) and the results (``published.json``). Each
size is an ordinary build of a drawing: RAPID and PacScript, read back, every motion tested against the arm itself, the
tool, the panel, the jig and the pedestal. Cylinders are three boxes each, which hold them and reach 22 % beyond.

cost: the sum over the tour of max over the joints of |dq| / v, as published. execution: the same motions from rest to
rest with their speeds and accelerations, all joints together. seconds: of the build by the clock, and what the process
took of the processor, which says more where others use the machine. Exits with 1 where a hole is left out or a tip is
off.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import ezdxf
import numpy as np

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
HOME = [0.0, -20.0, 130.0, 0.0, 70.0, 0.0]
SPEEDS, GAINS = np.array([1, 0.7, 0.7, 1, 0.7, 1.57]), np.array([5, 4.25, 4.25, 5.25, 6, 8.0])
TIP = [0.0, 120.0, 161.55]
#: mm: the tip stops so far before a hole. Where the jig's file stands in the robot's base.
STAND_OFF, JIG = 10.0, np.array([260.0, -418.0, 92.34])
#: The work frame: its z is against the drill, its x along the base's y; its origin is before the panel, at x = 570.
AXES, ORIGIN = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]]), np.array([570.0 - STAND_OFF, 0, 0])


def box(centre: list[float], half: list[float]) -> list[float]:
    """From corner to corner."""
    return [c - h for c, h in zip(centre, half, strict=True)] + [
        c + h for c, h in zip(centre, half, strict=True)
    ]


def cylinder(x: float, y: float, radius: float, low: float, high: float) -> list[list[float]]:
    """Three boxes that hold an upright cylinder."""
    side = math.sqrt(3) / 2
    shares = ((1, 0.5), (0.5, 1), (side, side))
    return [
        [x - a * radius, y - b * radius, low, x + a * radius, y + b * radius, high]
        for a, b in shares
    ]


def holder() -> list[list[float]]:
    """The coupling, the camera, and the drill down to its bit, at the flange."""
    return [
        box([-36.5, 0, 5], [65, 28, 5]),
        box([-73.5, 0, 62 - 20.8], [30, 105, 31.2]),
        box([0, 66.5, 17.5], [31.5, 95, 7.5]),
        *cylinder(0, 120, 21.65, 10, 26),
        *cylinder(0, 120, 21, 26, 69),
        *cylinder(0, 120, 16, 69, 91),
        *cylinder(0, 120, 33.15, -195, 5),
        *cylinder(22.45, 120, 40.9, -195, 5),
    ]


def to_work(points: FloatArray) -> FloatArray:
    """From the robot's base to the work frame."""
    return np.asarray((points - ORIGIN) @ AXES)


def standing(centre: list[float], half: list[float]) -> list[float]:
    """A box of the base frame in the work frame."""
    corners = to_work(np.array([np.subtract(centre, half), np.add(centre, half)]))
    return [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]


def job(jig: list[str]) -> dict[str, object]:
    """The job of every size."""
    angles = [math.degrees(angle) for angle in compute_fixed_xyz(frozen(AXES))]
    return {
        "operation": {"kind": "drill"},
        "tool": {"diameter": 10.0, "symmetric": True, "holder": holder()},
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
                standing([-32.5, 0, -216], [150, 150, 210]),
                standing([597, 0, 445], [27, 350, 350]),
                *jig,
            ],
        },
    }


def place_jig(source: Path, folder: Path) -> str:
    """The jig as a file in the work frame."""
    solid = camgen.read(source).solid
    assert solid is not None
    corners = to_work(solid.vertices + JIG)[solid.faces].astype("<f4")
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    rows = np.zeros(len(corners), dtype=kind)
    rows["corners"] = corners
    file = folder / "jig.stl"
    file.write_bytes(b"\0" * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return str(file)


def draw(holes: FloatArray, folder: Path) -> Path:
    """The stand-off points as circles of a drawing."""
    document = ezdxf.new(units=ezdxf.units.MM)
    space = document.modelspace()
    for x, y, _ in to_work(holes - [STAND_OFF, 0, 0]).tolist():
        space.add_circle((x, y), 5.0)
    file = folder / f"panel_{len(holes)}.dxf"
    document.saveas(file)
    return file


def made_holes() -> FloatArray:
    """Twelve holes of a panel, mm, robot base."""
    y, z = np.meshgrid([-75.0, -25, 25, 75], [370.0, 420, 470])
    return np.column_stack([np.full(12, 570.0), y.ravel(), z.ravel()])


def joints_of(result: camgen.Result) -> FloatArray:
    """The joint values (M, 6) where the motions end."""
    moves = result.program.columns.moves
    return np.array([(move.joints or move.target).values for move in moves])


def measure(joints: FloatArray) -> tuple[float, float]:
    """The cost and the seconds of execution."""
    way = np.abs(np.diff(joints, axis=0))
    short = way * GAINS < SPEEDS**2
    from_rest = np.where(short, 2 * np.sqrt(way / GAINS), way / SPEEDS + SPEEDS / GAINS)
    return float((way / SPEEDS).max(axis=1).sum()), float(from_rest.max(axis=1).sum())


def find_missed(joints: FloatArray, holes: FloatArray) -> int:
    """How many holes no motion ends before, with the tip within 0.01 mm and the axis along x."""
    rotation, origin = compute_flange(find_robot("VS-060"), joints)
    tips = origin + rotation @ pose_from_values([*TIP, 0, 0, 0]).origin
    drilled = tips[rotation[:, 0, 2] > 1 - 1e-9]
    apart = np.linalg.norm((holes - [STAND_OFF, 0, 0])[:, None] - drilled[None], axis=2)
    return int((apart.min(axis=1, initial=math.inf) > 0.01).sum())


def judge(holes: FloatArray, jig: list[str], published: list[str], folder: Path) -> Iterator[Cells]:
    """A row for each post."""
    drawing = draw(holes, folder)
    for post in POSTS:
        begin, used = time.perf_counter(), time.process_time()
        result = camgen.build(drawing, post=post, job=job(jig))
        seconds, used = time.perf_counter() - begin, time.process_time() - used
        joints = joints_of(result)
        missed = str(find_missed(joints, holes))
        is_right = missed == "0" and result.deviation.max_mm < 0.01
        figures = *measure(joints), seconds, used, *published
        yield len(holes), post, missed if is_right else Missed(missed), *figures


def columns_of(data: dict[str, object], size: int) -> list[str]:
    """The published figures of a size: the cost, the best execution of any step of the turns, the planner's seconds."""
    sizes, methods, steps = (
        data["number_of_targets"],
        data["methods"],
        data["robotsp_by_roll_step_deg"],
    )
    assert isinstance(sizes, list)
    assert isinstance(methods, dict)
    assert isinstance(steps, dict)
    at = sizes.index(size)
    runs = [one["execution_s"][at] for one in steps.values() if one["execution_s"][at] is not None]
    others = [one["cspace_cost"][at] for name, one in methods.items() if name.startswith("GLKH")]
    best = min((cost for cost in others if cost is not None), default=None)
    told = methods["RoboTSP"]
    glkh = "-" if best is None else f"{best:.1f}"
    return [
        f"{told['cspace_cost'][at]:.1f}",
        glkh,
        f"{min(runs):.1f} to {told['execution_s'][at]:.1f}",
        f"{told['cpu_s'][at]:.1f}",
    ]


def list_tasks(
    arguments: list[str], folder: Path
) -> Iterator[tuple[FloatArray, list[str], list[str]]]:
    """Holes, jig and published figures of each size."""
    if arguments[:1] == ["made"]:
        yield made_holes(), [], ["-"] * 4
        return
    data = Path(arguments[0])
    published = json.loads((data / "published.json").read_text())
    holes = np.loadtxt(data / "targets.csv", delimiter=",")[:, :3] * 1000
    jig = [place_jig(data / "jig.stl", folder)]
    for size in map(int, arguments[1:] or published["number_of_targets"]):
        # All holes are in the order in which they are listed.
        chosen = np.arange(len(holes))
        if size < len(holes):
            chosen = published["subsets"][str(size)]
        yield holes[chosen], jig, columns_of(published, size)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        tasks = ((*task, Path(folder)) for task in list_tasks(sys.argv[1:], Path(folder)))
        sys.exit(run(Scenario(COLUMNS, tasks, judge)))
