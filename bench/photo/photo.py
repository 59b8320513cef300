"""From photo to program, judged: rendered photos of known parts, built as a user would, measured against the drawing.

    python -m bench.photo.photo render DIR [COUNT] [SIZE]       COUNT (20) photos of 10 and of 1 megapixels and the hard
                                                                ones; with a SIZE, 10 or 1, those of that size alone
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

from bench.render.shapes import Loop
from bench.render.truth import Error, Truth, offset_truth, path_error
from bench.support.motions import sample_plane
from bench.support.runner import Table, machine, open_table
from bench.support.timing import best_seconds, measure_in_turns, measure_process, python
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
    if len(arguments) < 2 or arguments[0] not in ("render", "judge", "speed", "bare"):
        sys.exit(__doc__)
    what, folder, *rest = arguments
    place = Path(folder).resolve()
    if what == "bare":
        bare(place, to_contours=bool(rest))
        return 0
    if what == "render":
        place.mkdir(parents=True, exist_ok=True)
        draw(place, [int(word) for word in rest])
        return 0
    return {"judge": judge, "speed": speed}[what](place, rest)


def draw(folder: Path, numbers: list[int]) -> None:
    """numbers: of photos and of megapixels, as far as they are given."""
    from bench.render import photos as render_photos  # noqa: PLC0415 (speed imports nothing heavy, see bench.speed.processes)

    count, *size = numbers or [20]
    drawn = [photo for one in size or (10, 1) for photo in render_photos.photos(count, one)]
    for photo in drawn if size else (*drawn, *render_photos.hard()):
        begun = time.perf_counter()
        render_photos.write(folder, photo)
        print(f"{photo.name}: {time.perf_counter() - begun:.1f} s", flush=True)


# -- errors


def judge(folder: Path, names: list[str]) -> int:
    routes = " | ".join(f"{route}: max, rms mm | px" for route in ROUTES)
    table = open_table(
        "photo | plane by | tilt deg {:.0f} | mm/px {:.3f} | "
        f"{routes} | near corners, mm | path missed"
    )
    files = [folder / f"{name}.json" for name in names] or sorted(folder.glob("*-*mp.json"))
    files += [file for name in HARD if not names and (file := folder / f"{name}.json").is_file()]
    found: dict[tuple[str, str], list[tuple[Result, float]]] = {}
    for file in files:
        facts = json.loads(file.read_text())
        truth, scale = offset_truth(_loops(facts), facts["tool"] / 2), facts["mm_per_px"]
        results = [_result(folder, file.stem, facts["file"], truth, route) for route in ROUTES]
        table.add(file.stem, facts["way"], facts["tilt"], scale, *_row(results, scale))
        kind = "hard" if file.stem in HARD else file.stem.rsplit("-", 1)[-1]
        for route, result in zip(ROUTES, results, strict=True):
            found.setdefault((kind, route), []).append((result, scale))
    table = Table(
        "photos | route | built | max mm {:.3f} | px {:.2f} | rms mm {:.4f} | px {:.3f} "
        "| goal reached"
    )
    for (kind, route), pairs in sorted(found.items()):
        table.add(kind, route, *_sum(pairs))
    # The default is one of the two; it is enough that one of them reaches the goal everywhere.
    judged = {route: [_reached(*p) for (k, r), pairs in found.items() if r == route and k != "hard" for p in pairs]
              for route in PLANNERS}  # fmt: skip
    return 0 if any(all(reached) for reached in judged.values()) else 1


def _row(results: list[Result], scale: float) -> list[str]:
    cells = []
    for result in results:
        if isinstance(result, str):
            cells += [result[:_TOLD], ""]
        else:
            cells += [
                f"{result.largest:.3f}, {result.rms:.4f}",
                f"{result.largest / scale:.2f}, {result.rms / scale:.3f}",
            ]
    told = [result for result in results if isinstance(result, Error)]
    cells.append(", ".join(f"{error.near:.3f}" for error in told))
    cells.append(", ".join(f"{100 * error.missed:.1f} %" for error in told))
    return cells


def _reached(result: Result, scale: float) -> bool:
    if isinstance(result, str) or result.missed > 0:
        return False
    # Goals in px where pixels are larger than the paper's; tilt alone makes them larger by a few percent.
    larger = max(1.0, scale / (1.1 * PIXEL))
    return result.largest <= MOST * larger and result.rms <= RMS * larger


def _sum(pairs: list[tuple[Result, float]]) -> list[object]:
    told = [(result, scale) for result, scale in pairs if isinstance(result, Error)]
    if not told:
        return [f"0 of {len(pairs)}"]
    most, rms, scale = (
        np.array(column) for column in zip(*((e.largest, e.rms, s) for e, s in told), strict=True)
    )
    whole = [float(np.sqrt(np.mean(values**2))) for values in (rms, rms / scale)]
    figures = most.max(), (most / scale).max(), *whole
    reached = sum(_reached(*pair) for pair in pairs)
    return [f"{len(told)} of {len(pairs)}", *figures, f"{reached} of {len(pairs)}"]


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
    return python("camgen", "build", *files, *how)


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
            via = line["via"] if line["do"] == "movec" else None
            points.append(sample_plane(here, via, there, 0.1))
        here = there
    return np.concatenate(points)


# -- speed


def speed(folder: Path, names: list[str]) -> int:
    """Whole processes in turns, interpreter and imports included.

    They are the bare OpenCV calls with and without the distances, and both planners.
    """
    name = names[0] if names else "plate-10mp"
    rounds = int(names[1]) if len(names) > 1 else 5
    photo = json.loads((folder / f"{name}.json").read_text())["file"]
    with tempfile.TemporaryDirectory() as scratch:
        bare_calls = python("bench.photo.photo", "bare", folder / photo)
        contours = python("bench.photo.photo", "bare", folder / photo, "contours")
        commands = {"bare OpenCV calls": bare_calls, "bare calls for contours": contours}
        for planner in PLANNERS:
            command = build(folder, name, photo, Path(scratch), planner)
            commands[f"camgen build, {planner}"] = command
        values = measure_in_turns(commands, rounds)
    said = [measure_process(bare_calls).text.splitlines() for _ in range(rounds)]
    calls = min(float(lines[-1].split()[1]) for lines in said)
    print(f"{machine()}\n\nBare calls of one process, s: {', '.join(said[-1])}")
    table = Table(
        "process | best s {:.2f} | range s {:.2f} to {:.2f} | peak MB {:.0f} "
        "| times the bare process {:.2f} | times that for contours {:.2f} "
        "| times the bare calls {:.2f}"
    )
    best = min(run.seconds for run in values["bare OpenCV calls"])
    for_contours = min(run.seconds for run in values["bare calls for contours"])
    failed = False
    for what, runs in values.items():
        memory = max(run.peak for run in runs)
        seconds = [run.seconds for run in runs]
        least, most = min(seconds), max(seconds)
        failed |= least / best > TIMES or memory > MEMORY
        shares = least / best, least / for_contours, least / calls
        table.add(what, least, (least, most), memory, *shares)
    for planner in PLANNERS:
        seconds = _inside(folder, name, photo, planner, rounds)
        print(f"\nIn a process that runs already, {planner}: {seconds:.2f} s", end="")
    print()
    return int(failed)


def _inside(folder: Path, name: str, photo: str, planner: str, rounds: int) -> float:
    """The best time of a build from the photo to the checked program, everything imported."""
    import camgen  # noqa: PLC0415 (only where it is timed)
    from camgen.read.job_file import load_job  # noqa: PLC0415

    job = load_job(folder / f"{name}.toml", [f"operation.planner={planner}"])
    return best_seconds(lambda: camgen.build(folder / photo, post="pacscript", job=job), rounds)


def bare(photo: Path, *, to_contours: bool = False) -> None:
    """The calls of a route from a photo, once, with the seconds of each.

    to_contours: without the distances, which only the planner in image space needs.
    """
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
    if not to_contours:
        cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        told("distance")
    cv2.findContours(mask, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    told("contours")
    print(f"sum {begun[-1] - begun[0]:.3f}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
