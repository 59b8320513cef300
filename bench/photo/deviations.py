"""Photos of parts that differ from their drawing in eight ways: names of deviations, and rework.

    python -m bench.photo.deviations [ROUNDS, 5] [FIRST, 0] [NAME ...]

Eight photos a round, one a situation; or of the situations and parts that are named.

The rule: a round with the number k takes the plate, the bracket or a random part of
bench.render.parts. It draws by [k, number of the situation] a photo of each situation, from
straight above, at 0.14 mm a pixel, with grain and noise.

- clean: as drawn
- burrs: one to four, 0.3 to 2 mm high, 2 to 20 mm long, round or pointed, on straight pieces
- chips: one to three strips, 2 mm or more from the part, 5 to 48 mm long, 1.5 to 4 mm wide
- hole not drilled: a round hole is closed
- extra hole: a round hole of 2 to 4 mm radius, 2 mm or more from every outline
- screw: a disc of 0.4 to 0.75 of a round hole in it, without contact
- larger: the outer outline by 0.3 mm all along
- another part: the drawing is that of another random part

Outcomes, the worst one counts:

- dangerous: rework of a place without a burr, or for a burr that is a quarter and 0.1 mm lower;
  another part is accepted
- missed: nothing is listed at the place of a deviation
- misnamed: a deviation is listed as another kind, or something is listed that is not there
- refused: a photo of the drawn part is refused
- right: all deviations are listed as their kind, and nothing else is

The goal: all photos are right.

A second table has the time of the rework of four burrs on each of the named parts, drawn in the
same way, beside the time of a pass along all contours, and of the passes along all contours that
the highest burr needs. All are programs of `--post gcode` for a 4 mm tool at 8 mm/s.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

import camgen
from bench.photo.burrs import make_drawing
from bench.render.burrs import add_burrs
from bench.render.conditions import material
from bench.render.optics import shoot_from_above
from bench.render.parts import NAMED, Part, bracket, plate, random_part
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop, box, circle, hole
from bench.support.runner import Scenario, read_words, run, select, verdict
from camgen.check.photo import Difference, Inspection, inspect_photo, list_rework
from camgen.cli.rework import write_drawing, write_job
from camgen.model.job import ImageTable, Job
from camgen.read.files import Files
from camgen.read.image import read_outlines
from camgen.read.job_file import from_mapping

PIXEL, SIZE = 0.14, (1000, 800)
#: mm that a pass takes off.
REMOVAL = 0.2
#: The job of the times. A depth of nearly nothing, since the passes before were at one height.
JOB = {
    "tool": {"diameter": 4.0},
    "process": {"feed": 8.0, "spindle": 9000.0},
    "operation": {"depth": 1e-3},
}
#: Outcomes, the worst first.
OUTCOMES = ("dangerous", "missed", "misnamed", "refused", "right")


@dataclass(frozen=True)
class Truth:
    """A deviation that was made."""

    #: Its name.
    kind: str
    #: Middle, or tip of a burr, mm.
    place: complex = 0j
    #: Greatest distance from there to the place that is listed, mm.
    reach: float = np.inf
    #: Height of a burr, mm.
    height: float = 0.0


Scenery = tuple[tuple[Loop, ...], list[Truth]]


def situation(name: str, number: int) -> tuple[Part, Scenery]:
    """The part as drawn, the loops before the camera, and their truth."""
    rng = np.random.default_rng([number, list(SITUATIONS).index(name)])
    drawn = (plate, bracket, lambda: random_part(number))[number % 3]()
    return drawn, SITUATIONS[name](drawn, rng)


def _burrs(drawn: Part, rng: np.random.Generator) -> Scenery:
    loops, burrs = add_burrs(drawn, int(rng.integers(1, 5)), rng, 0.3, 2.0, (2.0, 20.0))
    return loops, [Truth("burr", b.place, b.width / 2 + 0.5, b.height) for b in burrs]


def _chips(drawn: Part, rng: np.random.Generator) -> Scenery:
    chips, truth = [], []
    taken = material(drawn)
    view = shapely.box(-66, -52, 66, 52)
    count = int(rng.integers(1, 4))
    while len(chips) < count:
        length, width = rng.uniform(5, 48), rng.uniform(1.5, 4)
        place = complex(*rng.uniform((-62, -48), (62, 48)))
        strip = box(-length / 2, -width / 2, length / 2, width / 2)
        chip = strip.moved(rng.uniform(0, np.pi), place)
        shape = material([chip])
        if shape.within(view) and shape.distance(taken) > 2:
            taken = shapely.union(taken, shape)
            chips.append(chip)
            truth.append(Truth("loose", place, length / 2 + 0.5))
    return (*drawn, *chips), truth


def _not_drilled(drawn: Part, rng: np.random.Generator) -> Scenery:
    which, middle, radius = _round_hole(drawn, rng)
    return drawn[:which] + drawn[which + 1 :], [Truth("feature missing", middle, radius + 0.5)]


def _extra(drawn: Part, rng: np.random.Generator) -> Scenery:
    region = material(drawn)
    while True:
        place, radius = complex(*rng.uniform((-36, -30), (36, 30))), rng.uniform(2, 4)
        disc = shapely.Point(place.real, place.imag).buffer(radius + 2)
        if disc.within(region):
            truth = Truth("feature extra", place, radius + 0.5)
            return (*drawn, hole(circle(place.real, place.imag, radius))), [truth]


def _screw(drawn: Part, rng: np.random.Generator) -> Scenery:
    _, middle, radius = _round_hole(drawn, rng)
    size = radius * rng.uniform(0.4, 0.75)
    middle += rng.uniform(0, 0.5) * (radius - size) * np.exp(1j * rng.uniform(0, 2 * np.pi))
    return (*drawn, circle(middle.real, middle.imag, size)), [Truth("loose", middle, size + 0.5)]


def _larger(drawn: Part, _rng: np.random.Generator) -> Scenery:
    outer = shapely.buffer(material(drawn[:1]), 0.3, quad_segs=32, join_style="mitre")
    points = shapely.get_coordinates(shapely.orient_polygons(outer).exterior)[:-1]
    loop = Loop(points[:, 0] + 1j * points[:, 1], np.zeros(len(points)))
    return (loop, *drawn[1:]), [Truth("dimension")]


SITUATIONS: dict[str, Callable[[Part, np.random.Generator], Scenery]] = {
    "clean": lambda drawn, _rng: (drawn, []),
    "burrs": _burrs,
    "chips": _chips,
    "hole not drilled": _not_drilled,
    "extra hole": _extra,
    "screw": _screw,
    "larger": _larger,
    "another part": lambda _drawn, rng: (
        random_part(1000 + int(rng.integers(1000))),
        [Truth("another part")],
    ),
}


def _round_hole(drawn: Part, rng: np.random.Generator) -> tuple[int, complex, float]:
    """Number, middle and radius of one of the round holes: loops of two half circles."""
    round_holes = [k for k, loop in enumerate(drawn) if len(loop.points) == 2]
    which = int(rng.choice(round_holes))
    ends = drawn[which].points
    return which, complex(ends.mean()), float(abs(ends[0] - ends[1]) / 2)


def photo(file: Path, loops: Sequence[Loop], seed: int) -> Path:
    """A dark part on a light bench from right above, its origin in the middle, turned by chance."""
    light = {"exposure": 0.9, "gradient": (0.1, -0.1)}
    shot = shoot_from_above(SIZE, PIXEL, blur=0.7, read=1.6, shot=0.01, seed=seed, **light)
    turn = np.random.default_rng(seed).uniform(-0.15, 0.15)
    layer = Layer(tuple(loop.moved(turn, 0j) for loop in loops), 0.15, texture=0.02)
    write_photo(file, render(Scene(0.7, (layer,), texture=0.02), shot))
    return file


def choose_outcome(inspection: Inspection | None, truth: Sequence[Truth]) -> str:
    """The outcome of a photo. inspection: None if it was refused."""
    is_other = any(deviation.kind == "another part" for deviation in truth)
    if inspection is None:
        return "right" if is_other else "refused"
    turns = np.exp(1j * np.array([0.0, *inspection.fit.rival_turns]))
    if is_other or not all(_is_true(burr, truth, turns) for burr in inspection.burrs):
        return "dangerous"
    return max((_name(inspection, truth, turn) for turn in turns), key=OUTCOMES.index)


def _is_true(burr: Difference, truth: Sequence[Truth], turns: np.ndarray) -> bool:
    """Whether a burr to rework is a burr, and about as high. turns: unit numbers, of the part."""
    return any(
        deviation.kind == "burr"
        and burr.height <= 1.25 * deviation.height + 0.1
        and (abs(complex(*burr.place) * turns - deviation.place) < deviation.reach).any()
        for deviation in truth
    )


def _name(inspection: Inspection, truth: Sequence[Truth], turn: complex) -> str:
    """The outcome of a photo without a dangerous job."""
    left = list(inspection.differences)
    outcomes = ["right"]
    for deviation in truth:
        near = [
            place
            for place in left
            if abs(complex(*place.place) * turn - deviation.place) < deviation.reach
        ]
        named = [place for place in near if place.kind == deviation.kind]
        if not named:
            outcomes.append("misnamed" if near else "missed")
        # All places of a part that is larger are one deviation.
        is_everywhere = deviation.reach == np.inf
        taken = {id(place) for place in (named if is_everywhere else (named or near)[:1])}
        left = [place for place in left if id(place) not in taken]
    if left:
        outcomes.append("misnamed")
    return min(outcomes, key=OUTCOMES.index)


def measure(name: str, rounds: int, first: int, folder: Path) -> Iterator[tuple[object, ...]]:
    """The row of a situation."""
    count = dict.fromkeys(OUTCOMES, 0)
    failures = []
    for number in range(first, first + rounds):
        drawn, (loops, truth) = situation(name, number)
        inspection = look(folder, drawn, loops, number)
        outcome = choose_outcome(inspection, truth)
        count[outcome] += 1
        if outcome != "right":
            failures.append(f"{number} {outcome}")
    goal = verdict(count["right"] == rounds and not count["dangerous"])
    yield name, rounds, *count.values(), ", ".join(failures), goal


def look(folder: Path, drawn: Part, loops: Sequence[Loop], number: int) -> Inspection | None:
    """The inspection of a photo, None if it is refused."""
    files, job = Files(), Job(image=ImageTable(mm_per_px=PIXEL))
    seen = read_outlines(files.read(photo(folder / "photo.png", loops, number)), job, files)
    try:
        return inspect_photo(seen, make_drawing(drawn), Job())
    except camgen.InputError:
        return None


def compare_times(name: str, folder: Path) -> Iterator[tuple[object, ...]]:
    """The row of a part with four burrs."""
    drawn = NAMED[name]()
    rng = np.random.default_rng(len(name))
    loops, _ = add_burrs(drawn, 4, rng, 0.3, 2.0, (2.0, 20.0))
    inspection = look(folder, drawn, loops, 0)
    job = from_mapping(JOB)
    works, _ = list_rework(inspection, job, REMOVAL)
    (folder / "again.toml").write_bytes(write_job(inspection, works, job, folder / "again.toml"))
    (folder / "again.dxf").write_bytes(write_drawing(works, inspection.expected.rings))
    (folder / "whole.dxf").write_bytes(write_drawing([], inspection.expected.rings))
    rework = camgen.build(folder / "again.dxf", post="gcode", job=folder / "again.toml").cycle
    whole = camgen.build(folder / "whole.dxf", post="gcode", job=JOB).cycle
    passes = [work.passes for work in works]
    former = max(math.ceil(work.burr.height / REMOVAL) for work in works)
    repeated = JOB | {"operation": {"depth": 1e-3, "passes": former}}
    former_s = camgen.build(folder / "whole.dxf", post="gcode", job=repeated).cycle.total
    shares = (100 * rework.total / whole.total, 100 * rework.total / former_s)
    yield name, len(works), sum(passes), rework.total, whole.total, former, former_s, *shares


def main(rounds: int, first: int, *names: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        outcomes = " | ".join(OUTCOMES)
        columns = f"situation | photos | {outcomes} | not right | goal"
        inputs = [(name, rounds, first, Path(folder)) for name in select(SITUATIONS, names)]
        times = "part | burrs | passes | rework s {:.1f} | a pass along all s {:.1f} "
        times += (
            "| passes before | all of them s {:.1f} | rework, % of a pass {:.0f} | % of all {:.0f}"
        )
        parts = [(name, Path(folder)) for name in select(NAMED, names)]
        return run(Scenario(columns, inputs, measure), Scenario(times, parts, compare_times))


if __name__ == "__main__":
    sys.exit(main(*read_words(5, 0)))
