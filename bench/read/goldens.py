"""Golden programs of the controllers: what they do, as points and events, and how far two are apart."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import camgen
from bench.support.motions import measure_from_lines, measure_motion, sample_motion
from bench.support.runner import ROOT
from camgen.lang.programs import Ask, Executed, find_language
from camgen.lang.taught import in_one_frame
from camgen.model.pose import Pose, Vec3, frozen
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL
from camgen.robots.catalogue import robot
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

CASES = ROOT / "fixtures" / "cases"
#: The controllers of robots, their suffixes, and the name that each gives to output k.
POSTS = {"rapid": (".mod", "do{}"), "vplus": (".v2", "{}"), "pacscript": (".pcs", "{}")}
#: The same for the controllers of mills; GRBL has a coolant for one signal.
MILLS = {"gcode": (".ngc", "P{}"), "grbl": (".nc", "M8")}
#: Whose joint values the golden programs have.
ARMS = {"rapid": "abb_irb120", "vplus": "adept_cobra_s600", "pacscript": "denso_vs060"}
#: mm: where no arc is printed, chords leave it by so much; digits are rounded twice on top.
CHORD = 0.02
#: mm between points that are compared.
_STEP = 0.2
#: So many points before and behind are looked at; so many points, and far ones, at a time.
_AROUND, _SOME, _FEW = 20, 2000, 50


def frames_of(case: Path, post: str) -> tuple[Pose, Pose]:
    """Base from work and flange from tool of a golden program: PacScript leaves them to the controller."""
    tables = tomllib.loads((case / "job.toml").read_text())
    own = {name: dict(tables[name]) for name in ("cell", "tool") if name in tables}
    cell = camgen.cell(post, own)
    return cell.base_from_work, cell.flange_from_tool


def pose_of(arm: Robot, joints: Joints, base: Pose, tool: Pose) -> Pose:
    """Where an arm has the tool at joint values, in the work frame. base: from work. tool: flange from tool."""
    turned, origin = flange(arm, np.array([joints.values]))
    x, y, z = origin[0].tolist()
    return base.inverse() @ Pose(frozen(turned[0]), (x, y, z)) @ tool


def execute(file: Path, language: str) -> Executed:
    """Runs a program."""
    return find_language(language).run({file.name: file.read_text(encoding="latin-1")}, Ask())


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
    arm = robot(ARMS[language])
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


def along(start: Vec3, item: MoveL | MoveC) -> tuple[list[Vec3], float]:
    """Points on a motion from ``start``, and its length, mm."""
    via = np.array(item.via.origin) if isinstance(item, MoveC) else None
    ends = np.array(start), via, np.array(item.target.origin)
    return sample_motion(*ends, _STEP).tolist(), measure_motion(*ends)


def apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The farthest that a point of one way is from the other, mm."""
    return max(_farthest(a, b), _farthest(b, a))


def _farthest(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """How far a point of ``a`` is at most from the lines along ``b``."""
    if len(b) < 2:
        return float(np.linalg.norm(a - b, axis=1).max())
    # Where as much of both ways is behind, and some points before and behind that: the order is the same.
    near = np.searchsorted(_shares(b), _shares(a))
    best = np.full(len(a), np.inf)
    for low in range(0, len(a), _SOME):
        some = slice(low, low + _SOME)
        beside = np.clip(near[some, None] + np.arange(-_AROUND, _AROUND), 0, len(b) - 2)
        best[some] = measure_from_lines(a[some, None], b[beside], b[beside + 1]).min(axis=1)
    far = np.flatnonzero(best > CHORD)
    for few in np.array_split(far, len(far) // _FEW + 1):
        best[few] = measure_from_lines(a[few, None], b[None, :-1], b[None, 1:]).min(axis=1)
    return float(best.max())


def _shares(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) of the whole way, what is behind at each point."""
    behind = np.append(0.0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum())
    return np.asarray(behind / max(behind[-1], 1e-9))
