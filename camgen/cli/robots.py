"""The command `robots`: lists the built-in robots, or describes one of them or of a URDF."""

from __future__ import annotations

import math
from argparse import Namespace

import numpy as np

from camgen.cli.say import Terminal, format_table
from camgen.model.text import short_each
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


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Print the table of robots, with -v their notes too; or the description of one robot."""
    if arguments.robot:
        chosen = find_robot(arguments.robot)
        if arguments.json:
            terminal.data(_as_data(chosen))
        else:
            terminal.out(_describe(chosen))
        return
    if arguments.json:
        terminal.data(list(map(_as_data, list_robots())))
        return
    rows = [("name", "maker", "joints", "kind", "kinematics", "limits")]
    notes = ""
    for robot in list_robots():
        joints, trust = str(len(robot.joints)), robot.trust
        rows.append((robot.name, robot.maker, joints, robot.kind, trust.kinematics, trust.limits))
        if terminal.verbose:
            notes += "".join(f"{robot.name}: {note}\n" for note in robot.notes)
    terminal.out(format_table(rows) + notes)


def _as_data(robot: Robot) -> dict[str, object]:
    """The properties of a robot, with joint values in deg or mm, and speeds in deg/s or mm/s."""
    joints = []
    for k, joint in enumerate(robot.joints):
        unit = 1.0 if joint.sliding else math.degrees(1)
        joints.append(
            {
                "name": joint.name,
                "sliding": joint.sliding,
                "limits": [round(value * unit, 6) for value in robot.limits[k].tolist()],
                "speed": round(float(robot.speeds[k]) * unit, 6),
                "home": round(float(robot.home[k]) * unit, 6),
            }
        )
    return {
        "name": robot.name,
        "maker": robot.maker,
        "kind": robot.kind,
        "convention": robot.convention,
        "trust": {"kinematics": robot.trust.kinematics, "limits": robot.trust.limits},
        "joints": joints,
        "notes": robot.notes,
    }


def _describe(robot: Robot) -> str:
    rows = [("joint", "moves", "from", "to", "speed", "home", "boxes")]
    for k, joint in enumerate(robot.joints):
        unit, name = (1.0, "mm") if joint.sliding else (math.degrees(1), "deg")
        values = np.array([*robot.limits[k], robot.speeds[k], robot.home[k]])
        low, high, speed, home = short_each((values * unit).tolist(), 3)
        link = robot.links[k + 1]
        limits = (f"{low} {name}", f"{high} {name}", f"{speed}/s")
        rows.append((joint.name, link.name, *limits, home, str(len(link.boxes))))
    head = f"{robot.name}\n{robot.convention}\n{_JOINTS[robot.kind]}\n"
    return head + format_table(rows) + "".join(f"note: {note}\n" for note in robot.notes)
