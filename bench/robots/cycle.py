"""Cycle times: length over speed beside acceleration, corners and joints; and LinuxCNC's own planner as the judge.

`python -m bench.robots.cycle [FILE ...] [--lines N ...]`: fixtures, the files, and programs of N lines (50,000 and
500,000). With `linuxcnc` as the file: programs
run by LinuxCNC in its simulator, in real time, about a minute. That needs the package linuxcnc-uspace; run by root it
also needs the user's number in RTAPI_UID and a path of that user's in RTAPI_FIFO_PATH, as LinuxCNC says itself.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

import camgen
from bench.support.runner import ROOT, Table, open_table
from bench.support.timing import median_seconds
from camgen.check.report import sum_up
from camgen.check.time import cycle, time_motions
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import MoveC, MoveJ, MoveL, Program
from camgen.post.plugins import find_post, make_post

JOBS: dict[str, tuple[str, dict[str, object]]] = {
    "bracket.dxf": ("parts/bracket.dxf", {}),
    "bracket.dxf, 100 mm/s": ("parts/bracket.dxf", {"process": {"feed": 100.0, "travel": 500.0}}),
    "bracket.dxf, IRB 120": ("parts/bracket.dxf", {"cell": {"robot": "IRB 120"}}),
    "rfa1.stl": ("parts/rfa1.stl", {}),
}
#: Programs for LinuxCNC are timed from the sampled speed; two motions are apart by more than so many samples of 1 ms.
_PAUSE = 100


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (float(x), float(y), float(z)))


def program(*moves: MoveL | MoveC) -> Program:
    frame = translation(0, 0, 0)
    return Program("p", frame, frame, (MoveJ(at(0, 0), 100.0), *moves))


def polyline(points: np.ndarray, speed: float) -> Program:
    last = len(points) - 1
    return program(
        *(
            MoveL(at(x, y), speed, 1.0 if k < last else 0.0)
            for k, (x, y) in enumerate(points[1:], 1)
        )
    )


def wave(count: int, length: float = 60.0) -> np.ndarray:
    t = np.linspace(0, 1, count)
    return np.column_stack([length * t, 10 * np.sin(0.2 * length * t)])


def cases() -> dict[str, Program]:
    zigzag = np.array([(2 * k, 3 * (k % 2)) for k in range(40)], float)
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20), (0, 0)], float)
    circle = (MoveC(at(10, 10), at(20, 0), 50.0, 1.0), MoveC(at(10, -10), at(0, 0), 50.0))
    small = (MoveC(at(1, 1), at(2, 0), 50.0, 1.0), MoveC(at(1, -1), at(0, 0), 50.0))
    return {
        "line 50 mm, 20 mm/s": program(MoveL(at(50, 0), 20.0)),
        "square 20 mm, 50 mm/s": polyline(square, 50.0),
        "circle R 10, 50 mm/s": program(*circle),
        "circle R 1, 50 mm/s": program(*small),
        "zigzag, 40 mm/s": polyline(zigzag, 40.0),
        "wave, 59 lines, 40 mm/s": polyline(wave(60), 40.0),
        "wave, 799 lines, 40 mm/s": polyline(wave(800), 40.0),
    }


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("files", nargs="*")
    arguments.add_argument("--lines", nargs="*", type=int, default=(50_000, 500_000))
    given = arguments.parse_args()
    if "linuxcnc" in given.files:
        judged()
        return
    table = open_table(
        "input | post | length over speed, s {:.1f} | time, s {:.1f} | travel, s {:.1f}"
    )
    more: dict[str, tuple[str, dict[str, object]]] = {
        Path(file).name: (str(Path(file).resolve()), {}) for file in given.files
    }
    for name, (file, job) in (JOBS | more).items():
        for post in ("rapid", "vplus", "gcode", "grbl"):
            if post != "rapid" and ("rfa" in file or "cell" in job):
                continue
            found = camgen.build(ROOT / "fixtures" / file, post=post, job=job)
            times = found.motions.seconds, found.cycle.total, found.cycle.travel
            table.add(name, post, *times)
    table = Table("lines {:,} | post | timed in, s {:.2f}")
    for count in given.lines:
        one = polyline(wave(count + 1, count / 10), 40.0)
        one.columns.ends, one.columns.speed, one.columns.blend  # noqa: B018 (read before the clock starts)
        for post in ("rapid", "gcode"):
            pace = make_post(find_post(post), {}).dynamics()
            table.add(count, post, median_seconds(partial(cycle, one, pace), 3))


def judged() -> None:
    """The programs of ``cases`` in LinuxCNC's simulator and here."""
    post = make_post(find_post("gcode"), {})
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        here.chmod(0o755)
        programs = [post.prepare(one, 0.01) for one in cases().values()]
        for k, one in enumerate(programs):
            (here / f"{k}.ngc").write_text(make_post(find_post("gcode"), {}).render(one)[0].text)
        configured(here)
        subprocess.run(
            ["linuxcnc", "-r", str(here / "mill.ini")], check=True, timeout=300, capture_output=True
        )
        table = open_table(
            "program | length over speed, s {:.3f} | camgen, s {:.3f} | LinuxCNC, s {:.3f} "
            "| apart {:+.2f} %"
        )
        for k, (name, one) in enumerate(zip(cases(), programs, strict=True)):
            ours = float(time_motions(one, post.dynamics(), None, None)[0].sum())
            theirs = sampled(here / f"{k}.txt")
            naive = sum_up(one.columns).seconds
            table.add(name, naive, ours, theirs, 100 * (ours / theirs - 1))


def sampled(file: Path) -> float:
    """Seconds of the last motion in a file of ``halsampler -t``: number of the sample, speed."""
    # The queue is full when reading begins, which is long before the motion.
    lines = [line for line in file.read_text().splitlines() if line != "overrun"]
    rows = np.array([[float(x) for x in line.split()[:2]] for line in lines])
    if (np.diff(rows[:, 0]) != 1).any():
        sys.exit(f"{file.name}: samples are missing")
    moving = np.flatnonzero(rows[:, 1] > 0)
    first = np.flatnonzero(np.diff(moving) > _PAUSE)
    return (len(moving) - (first[-1] + 1 if len(first) else 0)) * 1e-3


def configured(folder: Path) -> None:
    """A mill with 500 mm/s2 and 100 mm/s on all axes, driven by a script in the place of a screen."""
    axis = "MIN_LIMIT = -99999\nMAX_LIMIT = 99999\nMAX_VELOCITY = 1000\nMAX_ACCELERATION = 500\n"
    joint = "TYPE = LINEAR\nFERROR = 99\nMIN_FERROR = 99\nHOME_SEARCH_VEL = 0\nHOME_LATCH_VEL = 0\nHOME_SEQUENCE = 0\n"
    parts = [f"[AXIS_{name}]\n{axis}[JOINT_{k}]\n{axis}{joint}" for k, name in enumerate("XYZ")]
    screen = folder / "screen.py"
    (folder / "mill.ini").write_text(INI.format(screen=screen) + "".join(parts))
    (folder / "mill.hal").write_text(HAL)
    (folder / "tool.tbl").write_text("")
    screen.write_text(SCREEN)
    screen.chmod(0o755)


INI = """[EMC]
VERSION = 1.1
[DISPLAY]
DISPLAY = {screen}
[TASK]
TASK = milltask
CYCLE_TIME = 0.005
[RS274NGC]
PARAMETER_FILE = mill.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = 1000000
[HAL]
HALFILE = mill.hal
[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
DEFAULT_LINEAR_VELOCITY = 100
MAX_LINEAR_VELOCITY = 100
MAX_LINEAR_ACCELERATION = 500
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = tool.tbl
[KINS]
KINEMATICS = trivkins
JOINTS = 3
"""
HAL = """loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt sampler depth=4000 cfg=f
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf sampler.0 servo-thread
net p0 joint.0.motor-pos-cmd => joint.0.motor-pos-fb
net p1 joint.1.motor-pos-cmd => joint.1.motor-pos-fb
net p2 joint.2.motor-pos-cmd => joint.2.motor-pos-fb
net speed motion.current-vel => sampler.0.pin.0
net estop iocontrol.0.user-enable-out iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare iocontrol.0.tool-prepared
net change iocontrol.0.tool-change iocontrol.0.tool-changed
"""
SCREEN = """#!/usr/bin/python3
import pathlib, subprocess, time, linuxcnc
time.sleep(2)
command, stat = linuxcnc.command(), linuxcnc.stat()
for call, value in ((command.state, linuxcnc.STATE_ESTOP_RESET), (command.state, linuxcnc.STATE_ON),
                    (command.mode, linuxcnc.MODE_MANUAL), (command.home, -1)):
    call(value)
    command.wait_complete(5)
time.sleep(1)
for file in sorted(pathlib.Path(__file__).parent.glob("*.ngc")):
    command.mode(linuxcnc.MODE_MDI)
    command.wait_complete(5)
    command.mdi("G0 X0 Y0 Z0")
    command.wait_complete(30)
    time.sleep(2)
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete(5)
    command.program_open(str(file))
    with open(file.with_suffix(".txt"), "w") as out:
        sampler = subprocess.Popen(["/usr/bin/halsampler", "-t"], stdout=out)
        time.sleep(0.2)
        command.auto(linuxcnc.AUTO_RUN, 0)
        time.sleep(0.5)
        while stat.poll() or stat.interp_state != linuxcnc.INTERP_IDLE:
            time.sleep(0.02)
        time.sleep(0.3)
        sampler.terminate()
        sampler.wait()
"""

if __name__ == "__main__":
    main()
