"""A bracket before nine six-axis arms from public URDFs, and a second judge of collisions.

    python -m bench.robots.urdfs FOLDER [ARM ...]     all nine arms, or those named

FOLDER holds the repositories of ``ARMS`` at their commits, each in a folder called like it. None of
their files is part of camgen; arms whose URDF is missing are named.

The rule by which the nine were chosen:

- the four that were asked for: KR 10, IRB 120, IRB 6640 and UR5e;
- of each maker with complete six-axis URDFs in the data set (all meshes there, six joints that
  move, none of the four) the middle one by file name, (count - 1) // 2 of the sorted names.

The IRB 6640 is from ros-industrial/abb: the data set's copy names meshes that are not there.

The cell follows from the arm: the bracket stands on a block at ``AHEAD`` of the arm's reach, at
``UP`` of the height of its shoulder. The cell is the same for every version of camgen.

"Process" is `camgen build` as a whole: the least time of the processor of ``RUNS``. Other work on
the machine changes it less than the time by the clock.

The judge shares no code with the collision test. It reads the URDF and the visual meshes itself,
has forward kinematics of its own, and asks the library coal about pairs of bodies at ``SAMPLES``
places of each motion. Left out are neighbours in the chain and the tool at the part. Exits with 1
for a hit, and for an arm without a program.
"""

from __future__ import annotations

import itertools
import math
import re
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from trimesh.transformations import euler_matrix, rotation_matrix

import camgen
from bench.robots.parts import sample_program
from bench.robots.rfa import run_build
from bench.support.runner import Cells, Missed, Scenario, run
from bench.support.timing import timed
from camgen.robots.catalogue import find_robot

DATA_SET = "Daniella1/urdf_files_dataset", "81f4cdac42c3a51ba88833180db5bf3697988c87"
ABB = "ros-industrial/abb", "77db19bdb098f50d9569d1cab03ee657627e934e"
_MADE = "urdf_files/ros-industrial/xacro_generated"


class Source(NamedTuple):
    """A URDF: its repository, the commit, and the file there."""

    repository: str
    commit: str
    file: str

    def path(self, folder: Path) -> Path:
        """Its path in ``folder``."""
        return folder / self.repository.rpartition("/")[2] / self.file


ARMS = {
    "KR 10": Source(*DATA_SET, f"{_MADE}/kuka/kuka_kr10_support/urdf/kr10r1100sixx.urdf"),
    "IRB 120": Source(*DATA_SET, f"{_MADE}/abb/abb_irb120_support/urdf/irb120_3_58.urdf"),
    "IRB 6640": Source(*ABB, "abb_irb6600_support/urdf/irb6640.urdf"),
    "UR5e": Source(*DATA_SET, f"{_MADE}/universal_robots/ur_description/urdf/ur5e.urdf"),
    "IRB 4600": Source(*DATA_SET, f"{_MADE}/abb/abb_irb4600_support/urdf/irb4600_20_250.urdf"),
    "M-10iA": Source(*DATA_SET, f"{_MADE}/fanuc/fanuc_m10ia_support/urdf/m10ia7l.urdf"),
    "KR 3": Source(*DATA_SET, f"{_MADE}/kuka/kuka_kr3_support/urdf/kr3r540.urdf"),
    "TX2-90": Source(*DATA_SET, f"{_MADE}/staubli/staubli_tx2_90_support/urdf/tx2_90xl.urdf"),
    "UR16e": Source(*DATA_SET, f"{_MADE}/universal_robots/ur_description/urdf/ur16e.urdf"),
}
COLUMNS = (
    "arm | edges {} of {}, {} of them in pieces | build, s {:.1f} | process, s {:.2f} "
    "| not tested by the notes | rows {:,} | questions {:,} | hits"
)
#: Shares of the arm's length from its shoulder to its flange, and of the height of its shoulder.
AHEAD, UP = 0.5, 0.5
#: mm: width and height of the holder, length of the shaft from there to the tip; deg: its lean.
HOLDER, HIGH, SHAFT, LEAN = 60.0, 60.0, 80.0, 30.0
#: Processes of which the one with the least time of the processor counts.
RUNS = 3
#: Places of a motion at which the judge looks.
SAMPLES = 16
#: mm: sides of the bracket, its thickness and its length.
SIDE, THICK, LONG = 60.0, 12.0, 50.0
#: mm: how far the block under the bracket reaches beyond it, its height, and the gap between both.
BESIDE, DEEP, GAP = 20.0, 20.0, 0.5


def bracket() -> trimesh.Trimesh:
    """An angle of two plates: 17 convex edges, 4 of them at its foot."""
    outline = [(0, 0), (SIDE, 0), (SIDE, THICK), (THICK, THICK), (THICK, SIDE), (0, SIDE)]
    corners = np.array([(x, 0.0, z) for x, z in outline] + [(x, LONG, z) for x, z in outline])
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [*caps, *((6 + a, 6 + c, 6 + b) for a, b, c in caps)]
    for k in range(6):
        a, b = k, (k + 1) % 6
        faces += [(a, 6 + a, b), (b, 6 + a, 6 + b)]
    return trimesh.Trimesh(corners, faces, process=False)


def make_job(arm: Path) -> dict[str, dict[str, object]]:
    """The cell before an arm."""
    robot = find_robot(str(arm))
    shifts = [np.array(joint.previous_from_joint.origin) for joint in robot.joints]
    reach = sum(float(np.linalg.norm(shift)) for shift in (*shifts[2:], robot.flange.origin))
    ahead = AHEAD * reach + abs(float(shifts[1][0]))
    height = UP * float(shifts[0][2] + shifts[1][2])
    lean = math.radians(LEAN)
    tip = [-SHAFT * math.sin(lean), 0.0, HIGH + SHAFT * math.cos(lean), 0.0, -LEAN, 0.0]
    half = HOLDER / 2
    return {
        "input": {"select": "convex, not bottom"},
        "operation": {"offset": 2.0},
        "tool": {
            "holder": [[-half, -half, 0.0, half, half, HIGH]],
            "axis_tilt": 15.0,
            "symmetric": True,
        },
        "cell": {
            "robot": str(arm),
            "base_from_work": [ahead - SIDE / 2, -LONG / 2, height, 0.0, 0.0, 0.0],
            "flange_from_tool": tip,
            "fixtures": [[-BESIDE, -BESIDE, -DEEP - GAP, SIDE + BESIDE, LONG + BESIDE, -GAP]],
        },
    }


# The judge. Lengths mm.

Matrix = np.ndarray


def _read_numbers(element: ET.Element, name: str, default: str) -> Matrix:
    return np.array([float(word) for word in element.get(name, default).split()])


def _read_origin(element: ET.Element) -> Matrix:
    """The ``origin`` in an element, 4 x 4."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    matrix = euler_matrix(*_read_numbers(origin, "rpy", "0 0 0"))
    matrix[:3, 3] = 1000.0 * _read_numbers(origin, "xyz", "0 0 0")
    return np.asarray(matrix)


def _mesh(library: Any, vertices: Matrix, faces: Matrix) -> Any:
    model = library.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices))
    model.addTriangles(np.ascontiguousarray(faces, dtype=np.int32))
    model.endModel()
    return model


class Body(NamedTuple):
    """A body of the judge.

    name: name of its link.
    frame: number of the joint that moves it, 0 for a body that stands.
    shape: object of coal.
    placed: pose in the frame of that joint, 4 x 4.
    """

    name: str
    frame: int
    shape: Any
    placed: Matrix


class Judge:
    """Bodies and forward kinematics, from the URDF alone."""

    def __init__(self, file: Path, tip: str) -> None:
        import coal  # noqa: PLC0415 (installed where the bench is run)

        self.library = coal
        root = ET.parse(file).getroot()
        above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
        chain: list[ET.Element] = []
        name = tip
        while name in above:
            chain.append(above[name])
            name = above[name].find("parent").get("link")
        self.chain = chain[::-1]
        frames = {name: (0, np.eye(4))}
        count = 0
        # Fixed joints carry links beside the chain.
        left = [*self.chain, *(joint for joint in root.findall("joint") if joint not in chain)]
        for joint in left:
            parent, child = (joint.find(end).get("link") for end in ("parent", "child"))
            if parent not in frames:
                left.append(joint)
                continue
            frame, placed = frames[parent]
            if joint.get("type") == "fixed":
                frames[child] = frame, placed @ _read_origin(joint)
            else:
                count += 1
                frames[child] = count, np.eye(4)
        # The base of ROS's REP 199, from which poses count.
        self.base = frames["base"][1] if frames.get("base", (1,))[0] == 0 else np.eye(4)
        self.flange = count, frames[tip][1]
        self.bodies = list(self._visible(root, file, frames))

    def _visible(
        self, root: ET.Element, file: Path, frames: dict[str, tuple[int, Matrix]]
    ) -> Iterator[Body]:
        for link in root.findall("link"):
            for visual in link.findall("visual"):
                shown = visual.find("geometry/mesh")
                package, _, rest = shown.get("filename").partition("://")[2].partition("/")
                (home,) = [folder for folder in file.parents if folder.name == package]
                mesh = trimesh.load(home / rest, force="mesh", process=False)
                scale = _read_numbers(shown, "scale", "1 1 1")
                frame, placed = frames[link.get("name")]
                corners = 1000.0 * mesh.vertices * scale
                shape = _mesh(self.library, corners, mesh.faces)
                yield Body(link.get("name"), frame, shape, placed @ _read_origin(visual))

    def add_cell(self, result: camgen.Result, solid: trimesh.Trimesh) -> None:
        """Adds tool, holder, block and part of a job."""
        count, flange = self.flange
        holder, (x, y, z) = (HOLDER, HOLDER, HIGH), result.job.cell.flange_from_tool[:3]
        middle = np.eye(4)
        middle[2, 3] = HIGH / 2
        shaft = rotation_matrix(-math.radians(LEAN), (0.0, 1.0, 0.0))
        shaft[:3, 3] = np.array([x, y, z]) / 2 + np.array([0.0, 0.0, HIGH / 2])
        radius = result.job.tool.diameter / 2
        # Some mm short at both ends: of the holder, and of the tip that bends into the part.
        tool = self.library.Cylinder(radius, SHAFT - 4 * radius)
        work = self.base.copy()
        work[:3, 3] += self.base[:3, :3] @ np.array(result.job.cell.base_from_work[:3])
        block = work.copy()
        block[:3, 3] += self.base[:3, :3] @ np.array([SIDE / 2, LONG / 2, -DEEP / 2 - GAP])
        self.bodies += [
            Body("holder", count, self.library.Box(*holder), flange @ middle),
            Body("tool", count, tool, flange @ shaft),
            Body("block", 0, self.library.Box(SIDE + 2 * BESIDE, LONG + 2 * BESIDE, DEEP), block),
            Body("part", 0, _mesh(self.library, solid.vertices, solid.faces), work),
        ]

    def _list_pairs(self) -> list[tuple[Body, Body]]:
        """All but bodies that move together, links beside each other, and the tool at the part."""
        pairs = []
        for a, b in itertools.combinations(self.bodies, 2):
            links = not {a.name, b.name} & {"holder", "tool", "block", "part"}
            if a.frame == b.frame or (links and abs(a.frame - b.frame) == 1):
                continue
            if {a.name, b.name} != {"tool", "part"}:
                pairs.append((a, b))
        return pairs

    def count_hits(self, rows: Matrix) -> tuple[dict[tuple[str, str], int], int]:
        """The number of rows (N, J) at which each pair meets, and the number of questions."""
        pairs = self._list_pairs()
        counts: dict[tuple[str, str], int] = {}
        library = self.library
        for row in rows:
            frame, frames, joint = np.eye(4), [np.eye(4)], iter(row)
            for step in self.chain:
                frame = frame @ _read_origin(step)
                if step.get("type") != "fixed":
                    axis = _read_numbers(step.find("axis"), "xyz", "")
                    frame = frame @ rotation_matrix(next(joint), axis)
                    frames.append(frame)
            placed = {}
            for body in self.bodies:
                at = frames[body.frame] @ body.placed
                placed[id(body)] = library.Transform3s(at[:3, :3], at[:3, 3])
            for a, b in pairs:
                question = library.CollisionRequest(), library.CollisionResult()
                if library.collide(a.shape, placed[id(a)], b.shape, placed[id(b)], *question):
                    counts[a.name, b.name] = counts.get((a.name, b.name), 0) + 1
        return counts, len(rows) * len(pairs)


_NOT_TESTED = re.compile("not tested|do not meet|no boxes")


def list_untested(result: camgen.Result) -> list[str]:
    """The notes on pairs and links that are not tested."""
    notes = [f"{note.what} {note.why}" for note in result.notes]
    return list(filter(_NOT_TESTED.search, notes))


def main(words: list[str]) -> int:
    """Prints the table of all arms, or of those that are named."""
    solid = bracket()
    with tempfile.TemporaryDirectory() as scratch:
        part = Path(scratch) / "bracket.stl"
        part.write_bytes(solid.export(file_type="stl"))
        inputs = [(name, Path(words[0]), part, solid) for name in words[1:] or ARMS]
        return run(Scenario(COLUMNS, inputs, measure))


def measure(name: str, folder: Path, part: Path, solid: trimesh.Trimesh) -> Iterator[Cells]:
    """The row of an arm."""
    source = ARMS[name]
    file = source.path(folder)
    if not file.is_file():
        missing = f"missing: {source.repository} at {source.commit[:7]}, {source.file}"
        yield name, None, None, None, missing
        return
    try:
        result, seconds = timed(lambda: camgen.build(part, post="rapid", job=make_job(file)))
    except camgen.CamgenError as error:
        yield name, (0, 13, 0), None, None, Missed(str(error))
        return
    processor = min(run_build(part, make_job(file)).processor for _ in range(RUNS))
    paths = result.tour.paths
    done = {path.contours[0] for path in paths}
    pieces = done - {path.id for path in paths}
    listed = done.union(*(note.ids[-1:] for note in result.notes if note.kind == "skipped"))
    robot = find_robot(str(file))
    rows = [joints for _, joints in sample_program(result.program, robot, SAMPLES)]
    bodies = Judge(file, find_tip(file))
    bodies.add_cell(result, solid)
    counts, questions = bodies.count_hits(np.concatenate(rows))
    text = ", ".join(f"{a} against {b}: {count}" for (a, b), count in counts.items())
    count = sum(len(joints) for joints in rows)
    hits = Missed(text) if counts else "0"
    edges = len(done), len(listed), len(pieces)
    yield name, edges, seconds, processor, "; ".join(list_untested(result)), count, questions, hits


def find_tip(file: Path) -> str:
    """The link that camgen takes for the flange: the one whose name ends in `tool0`."""
    links = [link.get("name") for link in ET.parse(file).getroot().findall("link")]
    (tip,) = [name for name in links if name.endswith("tool0")]
    return tip


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
