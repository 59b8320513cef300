"""From photo to program: rendered photos of known parts, built as by a user, beside their drawing.

    python -m bench.photo.photo render DIR [COUNT, 20] [SIZE]
    python -m bench.photo.photo judge DIR [NAME ...]
    python -m bench.photo.photo speed DIR [NAME, plate-10mp] [RUNS, 5]

`render` draws COUNT photos of 10 and of 1 megapixels and the hard ones; with a SIZE, 10 or 1, those
of that size alone. `judge` prints the errors of their paths, `speed` seconds of whole processes
beside the bare OpenCV calls.

Each photo has NAME.toml (the job), NAME.yaml (the lens) and NAME.json (the truth). Points along the
planned motion, 0.1 mm apart at most, are compared with the exact offset of the drawing. Goals, away
from sharp corners by 1 mm: 0.05 mm and rms 0.015 mm, or 0.35 px and 0.1 px where pixels are larger.
The exit code is 1 if a goal is missed.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.render.shapes import Loop
from bench.render.truth import Error, Truth, offset_truth, path_error
from bench.support.motions import sample_plane
from bench.support.runner import Missed, Table, open_table
from bench.support.timing import measure_in_turns, python
from camgen.model.errors import CamgenError

PLANNERS = ("geometric", "image")
#: Photos that are harder than the rest in one thing, see `bench.render.photos.hard`, without goal.
HARD = ("srgb", "jpeg", "dim", "faint")
#: Planners, and the integer-pixel route of the paper.
ROUTES = (*PLANNERS, "paper")
#: Largest error and rms, mm, for pixels up to a size, mm.
MOST, RMS, PIXEL = 0.05, 0.015, 0.143
#: Largest time of a build beside the bare calls, and memory, MB.
TIMES, MEMORY = 2.5, 600
#: Characters of a refusal that are printed.
_SHOWN = 100


class Outcome(NamedTuple):
    """The outcome of a route on a photo.

    error: error of its path; the reason if there is no path.
    scale: mm of a pixel.
    """

    error: Error | str
    scale: float

    @property
    def is_reached(self) -> bool:
        """Whether the goals are met. Goals are in px where pixels are larger than the paper's."""
        if isinstance(self.error, str) or self.error.missed > 0:
            return False
        # Tilt alone makes pixels larger by a few percent.
        larger = max(1.0, self.scale / (1.1 * PIXEL))
        return self.error.largest <= MOST * larger and self.error.rms <= RMS * larger


def draw(folder: Path, numbers: list[int]) -> int:
    """Draws photos. numbers: count and megapixels, as far as they are given."""
    from bench.render import photos  # noqa: PLC0415 (speed imports nothing heavy)

    folder.mkdir(parents=True, exist_ok=True)
    count, *size = numbers or [20]
    drawn = []
    for megapixels in size or (10, 1):
        drawn += photos.photos(count, megapixels)
    for photo in drawn if size else (*drawn, *photos.hard()):
        start = time.perf_counter()
        photos.write(folder, photo)
        print(f"{photo.name}: {time.perf_counter() - start:.1f} s", flush=True)
    return 0


# -- errors


def compare_errors(folder: Path, names: list[str]) -> int:
    """Prints the errors of each photo, and a summary; 1 if no planner meets all goals."""
    routes = " | ".join(f"{route}: max, rms mm | px" for route in ROUTES)
    table = open_table(
        "photo | plane by | tilt deg {:.0f} | mm/px {:.3f} | "
        f"{routes} | near corners, mm | path missed"
    )
    files = [folder / f"{name}.json" for name in names] or sorted(folder.glob("*-*mp.json"))
    if not names:
        files += [file for name in HARD if (file := folder / f"{name}.json").is_file()]
    outcomes: dict[tuple[str, str], list[Outcome]] = defaultdict(list)
    for file in files:
        facts = json.loads(file.read_text())
        truth, scale = offset_truth(_list_loops(facts), facts["tool"] / 2), facts["mm_per_px"]
        kind = "hard" if file.stem in HARD else file.stem.rsplit("-", 1)[-1]
        errors = []
        for route in ROUTES:
            errors.append(_measure_route(folder, file.stem, facts["file"], truth, route))
            outcomes[kind, route].append(Outcome(errors[-1], scale))
        cells = _format_errors(errors, scale)
        table.add(file.stem, facts["plane"], facts["tilt"], scale, *cells)
    table = Table(
        "photos | route | built | max mm {:.3f} | px {:.2f} | rms mm {:.4f} | px {:.3f} "
        "| goal reached"
    )
    missed = set()
    for (kind, route), group in sorted(outcomes.items()):
        table.add(kind, route, *_sum_up(group))
        if kind != "hard" and not all(outcome.is_reached for outcome in group):
            missed.add(route)
    # The default is one of the planners; it is enough that one of them reaches the goal everywhere.
    return int(missed >= set(PLANNERS))


def _format_errors(errors: list[Error | str], scale: float) -> list[str]:
    cells, near, missed = [], [], []
    for error in errors:
        if isinstance(error, str):
            cells += [error[:_SHOWN], ""]
            continue
        cells.append(f"{error.largest:.3f}, {error.rms:.4f}")
        cells.append(f"{error.largest / scale:.2f}, {error.rms / scale:.3f}")
        near.append(f"{error.near:.3f}")
        missed.append(f"{100 * error.missed:.1f} %")
    return [*cells, ", ".join(near), ", ".join(missed)]


def _sum_up(outcomes: list[Outcome]) -> list[object]:
    built = [outcome for outcome in outcomes if isinstance(outcome.error, Error)]
    if not built:
        return [f"0 of {len(outcomes)}"]
    scale = np.array([outcome.scale for outcome in built])
    largest = np.array([outcome.error.largest for outcome in built])
    rms = np.array([outcome.error.rms for outcome in built])
    whole = [float(np.sqrt(np.mean(values**2))) for values in (rms, rms / scale)]
    reached = sum(outcome.is_reached for outcome in outcomes)
    counts = [f"{count} of {len(outcomes)}" for count in (len(built), reached)]
    return [counts[0], largest.max(), (largest / scale).max(), *whole, counts[1]]


def _list_loops(facts: dict[str, Any]) -> list[Loop]:
    loops = []
    for loop in facts["loops"]:
        loops.append(Loop(np.array(loop["points"]) @ [1, 1j], np.array(loop["bulges"])))
    return loops


def _measure_route(folder: Path, name: str, photo: str, truth: Truth, route: str) -> Error | str:
    """The error of a route, or the reason for which there is no path."""
    if route == "paper":
        from bench.photo.paper import paper_route  # noqa: PLC0415 (loads OpenCV)

        try:
            return path_error(paper_route(folder, name, photo, truth), truth)
        except CamgenError as error:
            return str(error)
    from bench.support.commands import run_camgen  # noqa: PLC0415 (imports the program)

    with tempfile.TemporaryDirectory() as scratch:
        plan = Path(scratch) / "plan.json"
        ran = run_camgen(*list_words(folder, name, photo, Path(scratch), route), "--plan", plan)
        return ran.lines[-1] if ran.code else path_error(read_planned(plan), truth)


def list_words(folder: Path, name: str, photo: str, output: Path, planner: str) -> list[object]:
    """The words of the command that builds a photo."""
    files = [folder / photo, "--job", folder / f"{name}.toml", "-o", output]
    options = ["--post", "pacscript", "--set", f"operation.planner={planner}", "-q"]
    return ["build", *files, *options]


def read_planned(plan: Path) -> np.ndarray:
    """Points (N,) of the motions of a plan file with the process on, mm, 0.1 mm apart at most."""
    points, position, is_on = [], np.zeros(3), False
    for line in json.loads(plan.read_text())["body"]:
        if line["do"] == "output":
            is_on = line["value"] > 0
        if line.get("to") is None:
            continue
        target = np.array(line["to"])
        if is_on:
            via = line["via"] if line["do"] == "movec" else None
            points.append(sample_plane(position, via, target, 0.1))
        position = target
    return np.concatenate(points)


# -- speed


def compare_speed(folder: Path, given: list[str]) -> int:
    """Prints whole processes in turns, interpreter and imports included; 1 if a goal is missed.

    They are the bare OpenCV calls with and without the distances, and both planners.
    """
    name = given[0] if given else "plate-10mp"
    runs = int(given[1]) if len(given) > 1 else 5
    photo = json.loads((folder / f"{name}.json").read_text())["file"]
    bare, contours = "bare OpenCV calls", "bare calls for contours"
    with tempfile.TemporaryDirectory() as scratch:
        commands = {
            bare: python("bench.photo.photo", "bare", folder / photo),
            contours: python("bench.photo.photo", "bare", folder / photo, "contours"),
        }
        for planner in PLANNERS:
            words = list_words(folder, name, photo, Path(scratch), planner)
            commands[f"camgen build, {planner}"] = python("camgen", *words)
        processes = measure_in_turns(commands, runs)
    table = open_table(
        "process | best s {:.2f} | range s {:.2f} to {:.2f} | peak MB {:.0f} "
        "| times the bare process {:.2f} | times that for contours {:.2f}"
    )
    best: dict[str, float] = {}
    for what, group in processes.items():
        memory = max(run.peak for run in group)
        longest = max(run.seconds for run in group)
        best[what] = min(run.seconds for run in group)
        times = best[what] / best[bare]
        is_missed = times > TIMES or memory > MEMORY
        cell = Missed(f"{times:.2f}") if is_missed else times
        seconds = best[what], (best[what], longest)
        for_contours = best[what] / best[contours] if contours in best else None
        table.add(what, *seconds, memory, cell, for_contours)
    return int(table.missed > 0)


def call_opencv(photo: Path, words: list[str]) -> int:
    """Calls what a route needs of OpenCV, once.

    words: `contours` for the calls without the distances, which only the planner in image space
        needs.
    """
    import cv2  # noqa: PLC0415 (no other mode needs it)

    grey = cv2.imdecode(np.fromfile(photo, np.uint8), cv2.IMREAD_GRAYSCALE)
    height, width = grey.shape
    matrix = np.array([[1.325 * width, 0, width / 2], [0, 1.325 * width, height / 2], [0, 0, 1]])
    tilted = cv2.Rodrigues(np.array([0.2, 0.1, 0.0]))[0]
    distortion = np.array([-0.1, 0.08, 1e-3, 1e-3, 0])
    maps = cv2.initUndistortRectifyMap(
        matrix, distortion, tilted, matrix, (width, height), cv2.CV_32FC1
    )
    view = cv2.remap(grey, *maps, cv2.INTER_LINEAR)
    _, mask = cv2.threshold(view, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    if "contours" not in words:
        cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cv2.findContours(mask, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    return 0


MODES = {"judge": compare_errors, "speed": compare_speed, "bare": call_opencv}


if __name__ == "__main__":
    mode, path, *rest = sys.argv[1:]
    target = Path(path).resolve()
    if mode == "render":
        sys.exit(draw(target, [int(word) for word in rest]))
    sys.exit(MODES[mode](target, rest))
