"""The command `robots`: lists the built-in robots, or describes one of them or of a URDF."""

from __future__ import annotations

import math
from argparse import Namespace

from camgen.cli.say import Terminal, format_table
from camgen.model.text import short
from camgen.robots.catalogue import find_robot, list_robots
from camgen.robots.models import Robot

#: Description of the inverse kinematics, by the kind of a robot.
_JOINTS = {
    "spherical-wrist": "joints in closed form: spherical wrist, 8 branches",
    "three-parallel": "joints in closed form: three parallel axes, 8 branches",
    "scara": "joints in closed form: SCARA, 2 branches",
    "cartesian": "joints in closed form: three slides",
    "serial": "joints by iteration: neither a spherical wrist nor three parallel axes",
}


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Print the table of robots, with -v their notes too; or the description of one robot."""
    if arguments.robot:
        chosen = find_robot(arguments.robot)
        if arguments.json:
            terminal.data(_as_data(chosen))
        else:
            terminal.out(_describe(chosen))
        return 0
    listed = list_robots()
    if arguments.json:
        terminal.data(list(map(_as_data, listed)))
        return 0
    rows = [("name", "maker", "joints", "kind", "kinematics", "limits")]
    rows += [
        (r.name, r.maker, str(len(r.joints)), r.kind, r.trust.kinematics, r.trust.limits)
        for r in listed
    ]
    text = format_table(rows)
    for row in listed if terminal.verbose else ():
        text += "".join(f"{row.name}: {note}\n" for note in row.notes)
    terminal.out(text)
    return 0


def _as_data(robot: Robot) -> dict[str, object]:
    """The properties of a robot, with joint values in deg or mm, and speeds in deg/s or mm/s."""
    units = [1.0 if joint.sliding else math.degrees(1) for joint in robot.joints]
    joints = []
    for k, (joint, unit) in enumerate(zip(robot.joints, units, strict=True)):
        row = {
            "name": joint.name,
            "sliding": joint.sliding,
            "limits": [round(float(value) * unit, 6) for value in robot.limits[k]],
            "speed": round(float(robot.speeds[k]) * unit, 6),
            "home": round(float(robot.home[k]) * unit, 6),
        }
        joints.append(row)
    trust = {"kinematics": robot.trust.kinematics, "limits": robot.trust.limits}
    names = {
        "name": robot.name,
        "maker": robot.maker,
        "kind": robot.kind,
        "convention": robot.convention,
    }
    return {**names, "trust": trust, "joints": joints, "notes": robot.notes}


def _describe(robot: Robot) -> str:
    rows = [("joint", "moves", "from", "to", "speed", "home", "boxes")]
    for k, joint in enumerate(robot.joints):
        unit, name = (1.0, "mm") if joint.sliding else (math.degrees(1), "deg")
        values = [*robot.limits[k].tolist(), float(robot.speeds[k]), float(robot.home[k])]
        low, high, speed, home = (short(value * unit, 3) for value in values)
        link = robot.links[k + 1]
        limits = (f"{low} {name}", f"{high} {name}", f"{speed}/s")
        rows.append((joint.name, link.name, *limits, home, str(len(link.boxes))))
    head = f"{robot.name}\n{robot.convention}\n{_JOINTS[robot.kind]}\n"
    return head + format_table(rows) + "".join(f"note: {note}\n" for note in robot.notes)
