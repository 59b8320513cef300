"""``camgen robots``: the built-in robots, how well their numbers are known, and one of them or a URDF more closely."""

from __future__ import annotations

import math
from argparse import Namespace

from camgen.cli.say import Voice, table
from camgen.model.text import short
from camgen.robots.catalogue import robot, robots
from camgen.robots.models import Robot

#: What is known of the closed form of the joints, for people.
_JOINTS = {
    "spherical-wrist": "joints in closed form: spherical wrist, 8 branches",
    "three-parallel": "joints in closed form: three parallel axes, 8 branches",
    "scara": "joints in closed form: SCARA, 2 branches",
    "cartesian": "joints in closed form: three slides",
    "serial": "joints by iteration: neither a spherical wrist nor three parallel axes",
}


def run(arguments: Namespace, says: Voice) -> int:
    """Prints the table of robots, with -v their notes too; or what is known of one."""
    if arguments.robot:
        found = robot(arguments.robot)
        if arguments.json:
            says.data(_as_data(found))
        else:
            says.out(_one(found))
        return 0
    if arguments.json:
        says.data([_as_data(one) for one in robots()])
        return 0
    rows = [("name", "maker", "joints", "kind", "kinematics", "limits")]
    known = robots()
    rows += [
        (r.name, r.maker, str(len(r.joints)), r.kind, r.trust.kinematics, r.trust.limits)
        for r in known
    ]
    text = table(rows)
    if says.verbose:
        text += "".join(f"{robot.name}: {note}\n" for robot in known for note in robot.notes)
    says.out(text)
    return 0


def _as_data(robot: Robot) -> dict[str, object]:
    """What is known of a robot: values of joints in deg, or mm where they slide, speeds by the second."""
    units = [1.0 if joint.sliding else math.degrees(1) for joint in robot.joints]
    joints = [
        {
            "name": joint.name,
            "sliding": joint.sliding,
            "limits": [round(float(value) * unit, 6) for value in robot.limits[k]],
            "speed": round(float(robot.speeds[k]) * unit, 6),
            "home": round(float(robot.home[k]) * unit, 6),
        }
        for k, (joint, unit) in enumerate(zip(robot.joints, units, strict=True))
    ]
    known = {"kinematics": robot.trust.kinematics, "limits": robot.trust.limits}
    names = {
        "name": robot.name,
        "maker": robot.maker,
        "kind": robot.kind,
        "convention": robot.convention,
    }
    return {**names, "trust": known, "joints": joints, "notes": robot.notes}


def _one(robot: Robot) -> str:
    rows = [("joint", "moves", "from", "to", "speed", "home", "boxes")]
    for k, joint in enumerate(robot.joints):
        unit, name = (1.0, "mm") if joint.sliding else (math.degrees(1), "deg")
        low, high = (short(value * unit, 3) for value in robot.limits[k].tolist())
        speed, home = short(float(robot.speeds[k]) * unit, 3), short(float(robot.home[k]) * unit, 3)
        boxes = str(len(robot.links[k + 1].boxes))
        rows.append(
            (
                joint.name,
                robot.links[k + 1].name,
                f"{low} {name}",
                f"{high} {name}",
                f"{speed}/s",
                home,
                boxes,
            )
        )
    lines = [robot.name, robot.convention, _JOINTS[robot.kind]]
    notes = [f"note: {note}" for note in robot.notes]
    return (
        "".join(f"{line}\n" for line in lines)
        + table(rows)
        + "".join(f"{note}\n" for note in notes)
    )
