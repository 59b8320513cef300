"""From photo to program, judged: rendered photos of known parts, built as a user would, measured against the drawing.

    python -m bench.photo.photo render DIR [COUNT] [SIZE]       COUNT (20) photos of 10 and of 1 megapixels and the hard
                                                                ones; with a SIZE, 10 or 1, those of that size alone
    python -m bench.photo.photo calibration DIR [COUNT] [SIZE]  COUNT (15) photos of a chessboard by the camera of SIZE
    python -m bench.photo.photo judge DIR [NAME ...]            path errors; exit code 1 where a goal is missed
    python -m bench.photo.photo speed DIR [NAME] [RUNS]         best seconds of RUNS (5), beside the bare OpenCV calls

Each photo has NAME.toml (the job), NAME.yaml (the lens) and NAME.json (the truth). Points along the planned motion, 0.1
mm apart at most, are compared with the exact offset of the drawing. Goals, away from sharp corners by 1 mm: 0.05 mm and
rms 0.015 mm, or 0.35 px and 0.1 px where pixels are larger.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.machine import machine
from bench.render.shapes import Loop
from bench.render.truth import Error, Truth, offset_truth, path_error
from bench.speed.processes import measured
from camgen.model.errors import CamgenError

PLANNERS = ("geometric", "image")
#: Photos that are harder than the rest in one thing, see render_photos.hard. No goal is set.
HARD = ("srgb", "jpeg", "dim", "faint")
#: The integer-pixel route of the paper beside them.
ROUTES = (*PLANNERS, "paper")
MOST, RMS, PIXEL = 0.05, 0.015, 0.143
TIMES, MEMORY = 2.5, 600
_TOLD = 100
#: An error, or the line that says why there is no path.
Result = Error | str


def main(arguments: list[str]) -> int:
    if len(arguments) < 2 or arguments[0] not in (
        "render",
        "calibration",
        "judge",
        "speed",
        "bare",
    ):
        sys.exit(__doc__)
    what, folder, *rest = arguments
    place = Path(folder).resolve()
    if what == "bare":
        bare(place)
        return 0
    if what in ("render", "calibration"):
        place.mkdir(parents=True, exist_ok=True)
        draw(what, place, [int(word) for word in rest])
        return 0
    return {"judge": judge, "speed": speed}[what](place, rest)


def draw(what: str, folder: Path, numbers: list[int]) -> None:
    """numbers: of photos and of megapixels, as far as they are given."""
    from bench.render import photos as render_photos  # noqa: PLC0415 (speed imports nothing heavy, see bench.speed.processes)

    if what == "calibration":
        count, size = (*numbers, *(15, 10)[len(numbers) :])
        render_photos.write_calibration(folder, size, count)
        return
    count, *size = numbers or [20]
    drawn = [photo for one in size or (10, 1) for photo in render_photos.photos(count, one)]
    for photo in drawn if size else (*drawn, *render_photos.hard()):
        begun = time.perf_counter()
        render_photos.write(folder, photo)
        print(f"{photo.name}: {time.perf_counter() - begun:.1f} s", flush=True)


# -- errors


def judge(folder: Path, names: list[str]) -> int:
    print(f"{machine()}\n\n| photo | plane by | tilt deg | mm/px |", end="")
    print("".join(f" {route}: max, rms mm | px |" for route in ROUTES), end="")
    print(
        " near corners, mm | path missed |\n|---|---|---|---|"
        + "---|---|" * len(ROUTES)
        + "---|---|"
    )
    files = [folder / f"{name}.json" for name in names] or sorted(folder.glob("*-*mp.json"))
    files += [file for name in HARD if not names and (file := folder / f"{name}.json").is_file()]
    found: dict[tuple[str, str], list[tuple[Result, float]]] = {}
    for file in files:
        facts = json.loads(file.read_text())
        truth, scale = offset_truth(_loops(facts), facts["tool"] / 2), facts["mm_per_px"]
        results = [_result(folder, file.stem, facts["file"], truth, route) for route in ROUTES]
        about = f"{file.stem} | {facts['way']} | {facts['tilt']:.0f} | {scale:.3f}"
        print(f"| {about} | {_row(results, scale)}", flush=True)
        kind = "hard" if file.stem in HARD else file.stem.rsplit("-", 1)[-1]
        for route, result in zip(ROUTES, results, strict=True):
            found.setdefault((kind, route), []).append((result, scale))
    print(
        "\n| photos | route | built | max mm | px | rms mm | px | goal reached |\n|---|---|---|---|---|---|---|---|"
    )
    for (kind, route), pairs in sorted(found.items()):
        print(f"| {kind} | {route} | {_sum(pairs)}", flush=True)
    # The default is one of the two; it is enough that one of them reaches the goal everywhere.
    judged = {route: [_reached(*p) for (k, r), pairs in found.items() if r == route and k != "hard" for p in pairs]
              for route in PLANNERS}  # fmt: skip
    return 0 if any(all(reached) for reached in judged.values()) else 1


def _row(results: list[Result], scale: float) -> str:
    cells = []
    for result in results:
        if isinstance(result, str):
            cells += [result[:_TOLD], ""]
        else:
            cells += [
                f"{result.most:.3f}, {result.rms:.4f}",
                f"{result.most / scale:.2f}, {result.rms / scale:.3f}",
            ]
    told = [result for result in results if isinstance(result, Error)]
    cells.append(", ".join(f"{error.near:.3f}" for error in told))
    cells.append(", ".join(f"{100 * error.missed:.1f} %" for error in told))
    return " | ".join(cells) + " |"


def _reached(result: Result, scale: float) -> bool:
    if isinstance(result, str) or result.missed > 0:
        return False
    # Goals in px where pixels are larger than the paper's; tilt alone makes them larger by a few percent.
    larger = max(1.0, scale / (1.1 * PIXEL))
    return result.most <= MOST * larger and result.rms <= RMS * larger


def _sum(pairs: list[tuple[Result, float]]) -> str:
    told = [(result, scale) for result, scale in pairs if isinstance(result, Error)]
    if not told:
        return f"0 of {len(pairs)} | | | | | |"
    most, rms, scale = (
        np.array(column) for column in zip(*((e.most, e.rms, s) for e, s in told), strict=True)
    )
    whole = [float(np.sqrt(np.mean(values**2))) for values in (rms, rms / scale)]
    figures = f"{most.max():.3f} | {(most / scale).max():.2f} | {whole[0]:.4f} | {whole[1]:.3f}"
    reached = sum(_reached(*pair) for pair in pairs)
    return f"{len(told)} of {len(pairs)} | {figures} | {reached} of {len(pairs)} |"


def _loops(facts: dict[str, Any]) -> list[Loop]:
    loops = []
    for loop in facts["loops"]:
        x, y = np.array(loop["points"]).T
        loops.append(Loop(x + 1j * y, np.array(loop["bulges"])))
    return loops


def _result(folder: Path, name: str, photo: str, truth: Truth, route: str) -> Result:
    """The error of one route, or the line that says why there is no path."""
    if route == "paper":
        from bench.photo.paper import paper_route  # noqa: PLC0415 (loads OpenCV)

        try:
            return path_error(paper_route(folder, name, photo, truth), truth)
        except CamgenError as error:
            return str(error)
    with tempfile.TemporaryDirectory() as scratch:
        plan = Path(scratch) / "plan.json"
        command = build(folder, name, photo, Path(scratch), route, "--plan", str(plan))
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return path_error(planned(plan), truth)


def build(folder: Path, name: str, photo: str, output: Path, planner: str, *more: str) -> list[str]:
    files = [str(folder / photo), "--job", str(folder / f"{name}.toml"), "-o", str(output)]
    how = ["--post", "pacscript", "--set", f"operation.planner={planner}", "-q", *more]
    return [sys.executable, "-m", "camgen", "build", *files, *how]


# -- the planned path


def planned(plan: Path) -> np.ndarray:
    """Points (N,) complex of all motions of a plan file while the process is on, 0.1 mm apart at most."""
    points, here, on = [], np.zeros(3), False
    for line in json.loads(plan.read_text())["body"]:
        if line["do"] == "output":
            on = line["value"] > 0
        if line.get("to") is None:
            continue
        there = np.array(line["to"])
        if on:
            points.append(
                _arc(here, np.array(line["via"]), there)
                if line["do"] == "movec"
                else _line(here, there)
            )
        here = there
    return np.concatenate(points)


def _line(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    a, b = complex(*start[:2]), complex(*end[:2])
    return np.linspace(a, b, int(abs(b - a) / 0.1) + 2)


def _arc(start: np.ndarray, via: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The circle through three points. From chord to chord an arc turns by half its sweep."""
    begin, a, b = complex(*start[:2]), complex(*(via - start)[:2]), complex(*(end - start)[:2])
    sweep = 2 * float(np.angle((b - a) / a))
    if abs(sweep) < 1e-9:
        return _line(start, end)
    centre = begin + a * b * (a - b).conjugate() / (a.conjugate() * b - a * b.conjugate())
    turns = np.linspace(0, sweep, int(abs(sweep) * abs(begin - centre) / 0.1) + 2)
    return centre + (begin - centre) * np.exp(1j * turns)


# -- speed


def speed(folder: Path, names: list[str]) -> int:
    """Whole processes in turns, interpreter and imports included: the bare OpenCV calls, and both planners."""
    name = names[0] if names else "plate-10mp"
    rounds = int(names[1]) if len(names) > 1 else 5
    photo = json.loads((folder / f"{name}.json").read_text())["file"]
    with tempfile.TemporaryDirectory() as scratch:
        commands = {
            "bare OpenCV calls": [
                sys.executable,
                "-m",
                "bench.photo.photo",
                "bare",
                str(folder / photo),
            ]
        }
        for planner in PLANNERS:
            commands[f"camgen build, {planner}"] = build(
                folder, name, photo, Path(scratch), planner
            )
        values: dict[str, list[tuple[float, float]]] = {what: [] for what in commands}
        for _ in range(rounds):
            for what, command in commands.items():
                seconds, _, peak = measured(command)
                values[what].append((seconds, peak))
    said = [_bare_said(folder / photo) for _ in range(rounds)]
    calls = min(float(lines[-1].split()[1]) for lines in said)
    print(f"{machine()}\n\nBare calls of one process, s: {', '.join(said[-1])}\n")
    print(
        "| process | best s | range s | peak MB | times the bare process | times the bare calls |"
    )
    print("|---|---|---|---|---|---|")
    best = min(s for s, _ in values["bare OpenCV calls"])
    failed = False
    for what, runs in values.items():
        memory = max(m for _, m in runs)
        least, most = min(s for s, _ in runs), max(s for s, _ in runs)
        failed |= least / best > TIMES or memory > MEMORY
        ratios = f"{least / best:.2f} | {least / calls:.2f}"
        print(f"| {what} | {least:.2f} | {least:.2f} to {most:.2f} | {memory:.0f} | {ratios} |")
    for planner in PLANNERS:
        print(
            f"\nIn a process that runs already, {planner}: {_inside(folder, name, photo, planner, rounds):.2f} s",
            end="",
        )
    print()
    return int(failed)


def _inside(folder: Path, name: str, photo: str, planner: str, rounds: int) -> float:
    """The best time of a build from the photo to the checked program, everything imported."""
    import camgen  # noqa: PLC0415 (only where it is timed)
    from camgen.read.job_file import load  # noqa: PLC0415

    job = load(folder / f"{name}.toml", [f"operation.planner={planner}"])
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        camgen.build(folder / photo, post="pacscript", job=job)
        times.append(time.perf_counter() - begun)
    return min(times)


def _bare_said(photo: Path) -> list[str]:
    command = [sys.executable, "-m", "bench.photo.photo", "bare", str(photo)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def bare(photo: Path) -> None:
    """What no route from a photo can do without, once, with the seconds of each call."""
    import cv2  # noqa: PLC0415 (only where this file is run for it)

    begun = [time.perf_counter()]

    def told(what: str) -> None:
        begun.append(time.perf_counter())
        print(f"{what} {begun[-1] - begun[-2]:.3f}")

    grey = cv2.imdecode(np.fromfile(photo, np.uint8), cv2.IMREAD_GRAYSCALE)
    told("decode")
    height, width = grey.shape
    matrix = np.array([[1.325 * width, 0, width / 2], [0, 1.325 * width, height / 2], [0, 0, 1]])
    tilted = cv2.Rodrigues(np.array([0.2, 0.1, 0.0]))[0]
    maps = cv2.initUndistortRectifyMap(
        matrix, np.array([-0.1, 0.08, 1e-3, 1e-3, 0]), tilted, matrix, (width, height), cv2.CV_32FC1
    )
    told("map")
    view = cv2.remap(grey, *maps, cv2.INTER_LINEAR)
    told("remap")
    _, mask = cv2.threshold(view, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    told("threshold")
    cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    told("distance")
    cv2.findContours(mask, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    told("contours")
    print(f"sum {begun[-1] - begun[0]:.3f}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
