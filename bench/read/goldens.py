"""Golden programs of the controllers: their motions as points, and the distance between two."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import camgen
from bench.support.motions import measure_from_lines, measure_motion, sample_motion
from bench.support.runner import ROOT
from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.lang.taught import in_one_frame
from camgen.model.pose import Pose, Vec3, frozen
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.models import Robot

CASES = ROOT / "fixtures" / "cases"
#: For each controller of robots: the suffix of its files, and its name of output k.
POSTS = {"rapid": (".mod", "do{}"), "vplus": (".v2", "{}"), "pacscript": (".pcs", "{}")}
#: For each controller of mills: suffix and name of output k. GRBL has one signal, a coolant.
MILLS = {"gcode": (".ngc", "P{}"), "grbl": (".nc", "M8")}
#: The arm of the joint values in the golden programs.
ARMS = {"rapid": "abb_irb120", "vplus": "adept_cobra_s600", "pacscript": "denso_vs060"}
#: mm: distance of a chord from its arc, where a controller prints no arcs.
CHORD = 0.02
#: Distance between points that are compared, mm.
_STEP = 0.2
#: Lines before and after a point that are measured first.
_NEIGHBOURS = 20
#: Points measured at a time: against their neighbours, and against all lines. It bounds memory.
_CHUNK, _FAR_CHUNK = 2000, 50


def frames_of(case: Path, post: str) -> tuple[Pose, Pose]:
    """Base from work and flange from tool of a case: PacScript leaves them to the controller."""
    tables = tomllib.loads((case / "job.toml").read_text())
    cell = camgen.cell(post, {name: tables[name] for name in ("cell", "tool") if name in tables})
    return cell.base_from_work, cell.flange_from_tool


def pose_of(arm: Robot, joints: Joints, base: Pose, tool: Pose) -> Pose:
    """The pose of the tool in the work frame at joint values of an arm.

    base: base from work.
    tool: flange from tool.
    """
    turned, origin = compute_flange(arm, np.array([joints.values]))
    x, y, z = origin[0].tolist()
    return base.inverse() @ Pose(frozen(turned[0]), (x, y, z)) @ tool


def execute(file: Path, language: str) -> Executed:
    """Runs a program."""
    return find_language(language).run(
        {file.name: file.read_text(encoding="latin-1")}, RunRequest()
    )


def execute_whole(file: Path, language: str) -> Executed:
    """Runs a program. ValueError if it stops or is refused."""
    executed = execute(file, language)
    if executed.stopped or any(finding.level == "refused" for finding in executed.findings):
        raise ValueError(f"{file.name}: {executed.stopped or executed.findings}")
    return executed


def read_robot(
    file: Path, language: str, frames: tuple[Pose, Pose]
) -> tuple[list[Instruction], Pose]:
    """The instructions of a robot's program with poses in one work frame, and base from work.

    Joint values of its home stay: the home of another arm is elsewhere.

    frames: base from work and flange from tool, for a text without them.
    """
    program = in_one_frame(execute_whole(file, language), file.name, 0.001)
    base = program.frames.base_from_work or frames[0]
    tool = program.frames.flange_from_tool or frames[1]
    arm = find_robot(ARMS[language])
    free = [item for item in program.body if isinstance(item, MoveJ)]
    joints = [item.target.values for item in free if isinstance(item.target, Joints)]
    homes = {*joints[:1], *joints[-1:]}
    body: list[Instruction] = []
    for item in program.body:
        by_joints = isinstance(item, MoveJ) and isinstance(item.target, Joints)
        if by_joints and item.target.values not in homes:
            item = replace(item, target=pose_of(arm, item.target, base, tool))  # noqa: PLW2901
        body.append(item)
    return body, base


def sample_between(start: Vec3, item: MoveL | MoveC) -> tuple[list[Vec3], float]:
    """Points on a motion from ``start``, and its length, mm."""
    via = np.array(item.via.origin) if isinstance(item, MoveC) else None
    ends = np.array(start), via, np.array(item.target.origin)
    return sample_motion(*ends, _STEP).tolist(), measure_motion(*ends)


def measure_apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The largest distance of a point of one polyline from the other, mm."""
    return max(_farthest(a, b), _farthest(b, a))


def _farthest(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The largest distance of a point of `a` from the lines of `b`, mm."""
    if len(b) < 2:
        return float(np.linalg.norm(a - b, axis=1).max())
    # Both run in the same order: the nearest line lies at about the same share of the length.
    near = np.searchsorted(_shares(b), _shares(a))
    best = np.full(len(a), np.inf)
    offsets = np.arange(-_NEIGHBOURS, _NEIGHBOURS)
    for low in range(0, len(a), _CHUNK):
        chunk = slice(low, low + _CHUNK)
        lines = np.clip(near[chunk, None] + offsets, 0, len(b) - 2)
        best[chunk] = measure_from_lines(a[chunk, None], b[lines], b[lines + 1]).min(axis=1)
    far = np.flatnonzero(best > CHORD)
    for chunk in np.array_split(far, len(far) // _FAR_CHUNK + 1):
        best[chunk] = measure_from_lines(a[chunk, None], b[None, :-1], b[None, 1:]).min(axis=1)
    return float(best.max())


def _shares(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The share of the length up to each point, (N,)."""
    lengths = np.append(0.0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum())
    return np.asarray(lengths / max(lengths[-1], 1e-9))
