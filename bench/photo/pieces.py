"""Lines and arcs of outlines in photos that are noisy, grained, blurred or shaken.

    python -m bench.photo.pieces [ROUNDS, 8] [FIRST, 4] [KIND ...]    six photos a round, one a kind

The rule: photo `kind` of the round with the number k draws by [41, k, number of the kind]. The part
is one of the four named ones in every second round, else a random part of bench.render.parts. It is
turned by any angle, is darker or lighter than the bench, and is seen from straight above at 0.13
to 0.14 mm a pixel. Ranges of contrast and noise (sigma) are in grey levels of 255:

| kind     | contrast  | noise         | grain        | blur (sigma) px | motion px |
|----------|-----------|---------------|--------------|-----------------|-----------|
| noise    | 5 to 120  | 0 to 4        | 0            | 0.5 to 1        | 0         |
| grain    | 40 to 120 | 0 to 2        | 1 to 8       | 0.5 to 1        | 0         |
| blur     | 40 to 120 | 0 to 2        | 0            | 1 to 3          | 0         |
| motion   | 40 to 120 | 0 to 2        | 0            | 0.5 to 1        | 2 to 9    |
| all      | 5 to 120  | 0 to 4        | 0 to 4       | 0.3 to 3        | 0 to 9    |
| notch    | 80 to 120 | 0 to 1        | 0            | 0.5 to 1        | 0         |

Contrast and grain are even in their logarithm (grain of "all": even), the others even. Noise is
half of the contrast at most, grain an eighth. Grain is that of bench.render.scene: streaks of 2 mm
along and 0.2 mm across, on part and bench. Motion has any direction. A notch is 0.3 mm deep and 2
to 6 mm wide, with sharp corners, in the middle of the longest line of the outer outline.

Measured, of `camgen.read`: lines and arcs beside those that were drawn (a circle is two arcs);
contours beside those that were drawn; distance of the contours from the drawing and of the drawing
from the contours. Places within 1.5 mm of a sharp corner are not measured.

The goal: each photo has the contours that were drawn, and at most 1.3 n + 4 lines and arcs for n. A
notch is found: the middle of its floor is nearer than 0.1 mm to the contours. No goal is set for
the distance.

Limits of camgen are chosen with the rounds 0 to 3 and from 100 on. Rounds 4 to 11 are for figures.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.render.optics import shoot_from_above
from bench.render.parts import NAMED, Part, random_part
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop, Pieces, are_away, find_corners, pieces, to_loops
from bench.support.runner import Scenario, read_words, run, select, verdict
from camgen.model.errors import CamgenError
from camgen.model.job import ImageTable, Job
from camgen.read.files import Files
from camgen.read.image import read

SIZE = (900, 900)
#: mm around a sharp corner that are not measured, and between places that are.
AWAY, STEP = 1.5, 0.05
NOTCH_DEPTH, NOTCH_FOUND = 0.3, 0.1
#: Joints that turn by more than this, rad, are corners.
TURN = 0.02
#: Most noise and grain, as shares of the contrast.
MOST_NOISE, MOST_GRAIN = 1 / 2, 1 / 8
#: Bounds of contrast, noise, grain, blur and motion.
Ranges = tuple[tuple[float, float], ...]
KINDS: dict[str, Ranges] = {
    "noise": ((5, 120), (0, 4), (0, 0), (0.5, 1), (0, 0)),
    "grain": ((40, 120), (0, 2), (1, 8), (0.5, 1), (0, 0)),
    "blur": ((40, 120), (0, 2), (0, 0), (1, 3), (0, 0)),
    "motion": ((40, 120), (0, 2), (0, 0), (0.5, 1), (2, 9)),
    "all": ((5, 120), (0, 4), (0, 4), (0.3, 3), (0, 9)),
    "notch": ((80, 120), (0, 1), (0, 0), (0.5, 1), (0, 0)),
}


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo to be made.

    loops: drawing in the frame of the bench, mm, the outer loop first.
    scale: mm a pixel.
    contrast, noise, grain: grey levels.
    blur: sigma, px.
    motion: px, u + i v.
    floor: middle of the floor of the notch, mm; nan without one.
    seed: number of the noise.
    """

    loops: Part
    scale: float
    contrast: float
    noise: float
    grain: float
    blur: float
    motion: complex
    floor: complex
    seed: int


@dataclass(frozen=True)
class Outcome:
    """The contours that were read of a photo, beside the drawing.

    drawn, read: number of lines and arcs.
    contours: number of those read minus number of those drawn.
    error: largest distance between contours and drawing, mm.
    square: mean of the squared distances of the contours, mm2.
    floor: distance of the middle of a notch's floor from the contours, mm; 0 without one.
    """

    drawn: int
    read: int
    contours: int
    error: float
    square: float
    floor: float

    @property
    def is_good(self) -> bool:
        """Whether the goal is met."""
        is_frugal = self.read <= 1.3 * self.drawn + 4
        return is_frugal and self.contours == 0 and self.floor < NOTCH_FOUND


def subject(kind: str, number: int) -> Subject:
    """The photo of a kind with the number of a round."""
    order = list(KINDS).index(kind)
    rng = np.random.default_rng([41, number, order])
    named = list(NAMED.values())[number // 2 % len(NAMED)]
    part = random_part(1000 * order + number) if number % 2 else named()
    contrasts, noises, grains, blurs, motions = KINDS[kind]
    contrast = _even_in_log(rng, contrasts)
    noise = min(rng.uniform(*noises), MOST_NOISE * contrast)
    grain = rng.uniform(*grains) if grains[0] == 0 else _even_in_log(rng, grains)
    blur, length = rng.uniform(*blurs), rng.uniform(*motions)
    motion = length * np.exp(1j * rng.uniform(0, np.pi))
    floor = complex(np.nan)
    if kind == "notch":
        outer, floor = with_notch(part[0], rng.uniform(2, 6))
        part = (outer, *part[1:])
    turn, place = rng.uniform(0, 2 * np.pi), complex(*rng.uniform(-0.5, 0.5, 2))
    return Subject(
        tuple(loop.moved(turn, place) for loop in part),
        rng.uniform(0.13, 0.14),
        contrast * rng.choice([-1.0, 1.0]),
        noise,
        min(grain, MOST_GRAIN * contrast),
        blur,
        complex(motion),
        floor * np.exp(1j * turn) + place,
        number,
    )


def _even_in_log(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))


def with_notch(loop: Loop, width: float) -> tuple[Loop, complex]:
    """The loop with a notch in its longest line, material on the left; the middle of the floor."""
    chord = np.roll(loop.points, -1) - loop.points
    k = int(np.argmax(np.where(loop.bulges == 0, np.abs(chord), 0)))
    along = chord[k] / abs(chord[k])
    middle = loop.points[k] + chord[k] / 2
    foot, deep = along * width / 2, 1j * along * NOTCH_DEPTH
    notch = np.array([middle - foot, middle - foot + deep, middle + foot + deep, middle + foot])
    points = np.insert(loop.points, k + 1, notch)
    return Loop(points, np.insert(loop.bulges, k + 1, np.zeros(4))), middle + deep


def photo(file: Path, what: Subject) -> Path:
    """The photo of a subject, the middle of the bench in the middle of the photo."""
    noise = {"blur": what.blur, "motion": what.motion, "read": what.noise, "seed": what.seed}
    shot = shoot_from_above(SIZE, what.scale, **noise)
    bench, part = (0.5 + share * what.contrast / 255 for share in (-0.5, 0.5))
    grain = what.grain / 255
    layer = Layer(what.loops, part, grain / part)
    write_photo(file, render(Scene(bench, (layer,), grain / bench, what.seed), shot))
    return file


def look(what: Subject, folder: Path) -> Outcome:
    """The outcome of a photo. CamgenError if it is refused."""
    files, job = Files(), Job(image=ImageTable(mm_per_px=what.scale))
    contours = read(files.read(photo(folder / "photo.png", what)), job, files).contours
    # The frame of a picture begins at its lower left corner, that of the bench in its middle.
    shift = complex(*SIZE) / 2 * what.scale
    truth, result = pieces(what.loops), pieces(to_loops(contours, shift))
    corners = find_corners(what.loops, TURN)
    errors = truth.distance(walked(result, corners))
    missing = result.distance(walked(truth, corners))
    floor = result.distance(np.array([what.floor]))[0] if np.isfinite(what.floor) else 0.0
    return Outcome(
        len(truth.start),
        len(result.start),
        len(contours) - len(what.loops),
        float(max(errors.max(initial=0), missing.max(initial=0))),
        float((errors**2).mean()),
        float(floor),
    )


def walked(whole: Pieces, corners: np.ndarray) -> np.ndarray:
    """Places (N,) on the pieces, away from the corners."""
    places = whole.walk_evenly(STEP)
    return places[are_away(places, corners, AWAY)]


def measure(kind: str, rounds: int, first: int, folder: Path) -> Iterator[tuple[object, ...]]:
    """The row of a kind."""
    outcomes: list[Outcome] = []
    failures: list[str] = []
    refused = 0
    for number in range(first, first + rounds):
        try:
            outcome = look(subject(kind, number), folder)
        except CamgenError:
            refused += 1
            failures.append(f"{number} refused")
            continue
        outcomes.append(outcome)
        if not outcome.is_good:
            failures.append(f"{number}: {outcome.read} for {outcome.drawn}")
    drawn = sum(outcome.drawn for outcome in outcomes)
    read_pieces = sum(outcome.read for outcome in outcomes)
    times = max((outcome.read / outcome.drawn for outcome in outcomes), default=np.nan)
    error = max((outcome.error for outcome in outcomes), default=np.nan)
    rms = np.sqrt(np.mean([outcome.square for outcome in outcomes])) if outcomes else np.nan
    good = sum(outcome.is_good for outcome in outcomes)
    figures = drawn, read_pieces, times, error, rms, good, ", ".join(failures)
    yield kind, rounds, refused, *figures, verdict(good == rounds)


def main(rounds: int, first: int, *names: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        columns = "kind | photos | refused | pieces drawn | read | worst, times {:.2f} "
        columns += "| largest distance mm {:.3f} | rms mm {:.4f} | good | not good | goal"
        inputs = [(kind, rounds, first, Path(folder)) for kind in select(KINDS, names)]
        return run(Scenario(columns, inputs, measure))


if __name__ == "__main__":
    sys.exit(main(*read_words(8, 4)))
