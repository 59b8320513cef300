"""docs/robots.md: the built-in arms, from their data."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.cell import Cell
from camgen.model.pose import Pose, compute_fixed_xyz
from camgen.model.text import short
from camgen.post.plugins import find_post, list_installed, make_post
from camgen.robots.catalogue import list_robots
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Robot

_KINDS = {
    "spherical-wrist": "closed form, spherical wrist",
    "scara": "closed form, SCARA",
    "cartesian": "closed form, three slides",
    "serial": "iteration",
}
_CELLS = """
## Built-in cells

A job without `[cell]` is made for the cell of its post. It is an example for a first program,
without a check of reach until `cell.robot` names an arm. Frames are x, y, z in mm and rx, ry, rz
in deg, joints deg or mm. The length of the tool in a job replaces that of the cell.
"""
#: Number of postures with which the search for the reach continues.
_KEPT_POSTURES = 10
_INTRODUCTION = """\
# Robots

These robots are built in: `cell.robot = "IRB 1200"` in a [job](job.md) names one. `camgen robots`
lists them, `camgen robots "IRB 120"` shows one with its boxes. Capitals, spaces and hyphens in a
name do not matter. Any other arm can be read from a URDF file: [cells](cells.md).

With `cell.robot` every motion is checked for reach, joint limits and collisions of the boxes.
Without it nothing of this is checked, as the summary says.

The `3-axis mill` is for the posts `gcode` and `grbl`, the arms are for the others. The travel of
the mill is checked along the whole program:

    camgen build bracket.dxf --post gcode --set cell.robot="3-axis mill"

A part that leaves the travel of an axis ends with exit code 3 and a line that names the axis, the
limit and the value. `cell.base_from_work` is the work offset (G54) in machine coordinates.
Without it the home of the job is assumed to be the home of the machine; the summary gives the
work zero.

- **Reach** is the maximum distance of the centre of the flange from axis 1, measured level,
  within the joint limits. A search over the model finds it; a data sheet often ends at the wrist.
- **Trust** grades the numbers. *Confirmed*: two independent sources agree. *Derived*: one good
  source, or computed. *Uncertain*: check it before you rely on it.
- **Speeds** are the maximum of each joint. They are used for times, to choose between two links,
  and to examine the feeds: the summary names each path on which a joint cannot keep the feed,
  with the place, the axis and the speed that is left. `--strict` refuses it, and a feed beyond
  all joints together is refused.
- **Joint values** are those that the controller shows.

Joints are in deg and deg/s, sliding joints in mm and mm/s. This page is generated from the data
of the models (`python -m docs.make.pages`); a test keeps it current.

"""


def robots_page() -> str:
    """The text of docs/robots.md."""
    known = list_robots()
    rows = ["| robot | maker | joints | reach, mm | solved by |", "|---|---|---|---|---|"]
    for r in known:
        link = f"[{r.name}](#{_anchor(r.name)})"
        cells = (link, r.maker, str(len(r.joints)), _reach(r), _KINDS[r.kind])
        rows.append(f"| {' | '.join(cells)} |")
    return _INTRODUCTION + "\n".join(rows) + "\n" + _cells() + "".join(_section(r) for r in known)


def _cells() -> str:
    """The built-in cell of each post."""
    rows = [
        _CELLS,
        "| post | cell | `base_from_work` | `flange_from_tool` | `home` |",
        "|---|---|---|---|---|",
    ]
    for name in sorted(post.name for post in list_installed() if post.origin.startswith("camgen ")):
        cell = make_post(find_post(name), {}).cell()
        frames = " | ".join(_values(pose) for pose in (cell.base_from_work, cell.flange_from_tool))
        rows.append(f"| `{name}` | {cell.name} | {frames} | {_home(cell)} |")
    return "\n".join(rows) + "\n"


def _values(pose: Pose) -> str:
    angles = (math.degrees(angle) for angle in compute_fixed_xyz(pose.rotation))
    return ", ".join([*(short(v, 3) for v in pose.origin), *(short(a, 4) for a in angles)])


def _home(cell: Cell) -> str:
    if isinstance(cell.home, Pose):
        return _values(cell.home)
    units = [1.0 if k in cell.sliding else math.degrees(1) for k in range(len(cell.home.values))]
    return ", ".join(
        short(value * unit, 3) for value, unit in zip(cell.home.values, units, strict=True)
    )


def _anchor(name: str) -> str:
    return "".join(c for c in name.lower().replace(" ", "-") if c.isalnum() or c == "-")


def _section(r: Robot) -> str:
    grades = {what: getattr(r.trust, what) for what in ("kinematics", "limits", "speeds", "boxes")}
    trust = ", ".join(f"{what} {grade}" for what, grade in grades.items())
    if len(set(grades.values())) == 1:
        trust = f"all {r.trust.kinematics}"
    boxes = sum(len(link.boxes) for link in r.links)
    lines = [
        f"\n## {r.name}\n",
        f"{r.maker}, {r.controller}. {r.convention}\n",
        "| joint | from, to | speed a second | home |",
        "|---|---|---|---|",
        *_joints(r),
        "",
        f"- Trust: {trust}. {boxes} boxes, grown by {short(r.pad, 1)} mm.",
        *(f"- Note: {note}" for note in r.notes),
        *(f"- Source: {source}." for source in r.sources),
    ]
    return "\n".join(lines) + "\n"


def _joints(r: Robot) -> list[str]:
    rows = []
    for k, joint in enumerate(r.joints):
        unit = 1.0 if joint.sliding else math.degrees(1)
        name = f"{joint.name}, mm" if joint.sliding else joint.name
        low, high = (short(float(value) * unit, 3) for value in r.limits[k])
        speed, home = short(float(r.speeds[k]) * unit, 3), short(float(r.home[k]) * unit, 3)
        rows.append(f"| {name} | {low}, {high} | {speed} | {home} |")
    return rows


def _reach(r: Robot) -> str:
    if r.kind == "cartesian":
        return " x ".join(short(float(high - low), 1) for low, high in r.limits)
    return short(round(reach(r)), 0)


def reach(r: Robot) -> float:
    """The maximum distance of the flange from axis 1 within the limits, mm.

    The search begins with random postures and improves the best ones.
    """
    rng = np.random.default_rng(0)
    low, high = r.limits[:, 0], r.limits[:, 1]
    best = rng.uniform(low, high, (4000, len(low)))
    best = best[np.argsort(_measure_distance(r, best))[-_KEPT_POSTURES:]]
    for step_size in 0.5 ** np.arange(24):
        tries = best[:, None] + rng.normal(0, 0.3 * step_size, (_KEPT_POSTURES, 50, len(low))) * (
            high - low
        )
        tries = np.concatenate([best, np.clip(tries, low, high).reshape(-1, len(low))])
        best = tries[np.argsort(_measure_distance(r, tries))[-_KEPT_POSTURES:]]
    return float(_measure_distance(r, best).max())


def _measure_distance(r: Robot, joints: np.ndarray) -> np.ndarray:
    """The distance of the flange from axis 1, mm; -1 for joint values beyond the limits."""
    origins = compute_flange(r, joints)[1]
    return np.where(are_within_limits(r, joints), np.hypot(origins[:, 0], origins[:, 1]), -1.0)
