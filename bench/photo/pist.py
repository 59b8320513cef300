"""The case study of docs/pist.md.

    python -m bench.photo.pist [--figures] [--small]    the paper's results; the page's pictures drawn again
    python -m bench.photo.pist --feed [--small]         the observed feed and the force, on ten photos by both planners;
                                                        exit code 1 where more than 2 % of the contact is 5 % off

--small: one photo with a tenth of the pixels, for a try.

The paper's part (3 x 2.5 in, tool 3/8 in, 5 mm/s, 2 N) is put in three places. Of each a photo is rendered as the
paper's camera would see it, and built for a Denso controller: the vision route. The CAD route is the paper's: a
drawing is planned once, the clamped part is scanned, ``camgen localize`` finds it, and the path is moved there. What
the programs do is compared with the exact path; a model of the contact (bench/photo/contact.py) says what force it
costs.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import numpy as np

import camgen
from bench.photo.contact import Contact, pressed
from bench.photo.observed import Observed, Run, observe, run
from bench.photo.paper import paper_route
from bench.photo.pist_figures import contacts, errors, frames
from bench.render.parts import paper
from bench.render.photos import Photo, of_paper, write
from bench.render.shapes import Loop
from bench.render.solid import sheet
from bench.render.truth import Error, Truth, offset_truth, path_error
from bench.support.runner import ROOT, Table, machine, open_table
from bench.support.timing import timed
from camgen.cli import main as command
from camgen.model.pose import pose_from_values
from camgen.preview.photo_stages import svg
from camgen.read.job_file import load_job
from tests.support.clouds import ROUND, scan

IMAGES = ROOT / "docs" / "images"
FEED, FORCE = 5.0, 2.0
#: mm: thickness of the sheet, noise of the scanner, and how far from its place (mm, deg) the part is said to be.
THICK, NOISE, ABOUT = 2.0, 0.05, (5.0, 4.0)
#: Points of the scan, without and with `--small`.
POINTS, FEW_POINTS = 50_000, 5_000
#: The scanner runs over the part and so far (mm) beyond its ends, at this speed (mm/s).
BEYOND, SCAN_FEED = 20.0, 10.0
#: Where the middle of the part is before the arm, mm; the tool's rest is the post's.
BEFORE = (350.0, 0.0, 150.0)
CAD, EXACT, IMAGE, PIXELS = (
    "drawing, scan, localize",
    "photo, geometric",
    "photo, image space",
    "photo, whole pixels",
)
#: The share of the contact that may be more than 5 % off the feed.
MOST_OFF = 0.02
#: Away from where force is put on, mm of path.
SETTLED = 8.0


@dataclass(frozen=True, eq=False)
class Route:
    """What one route does at one place. run: its program. error, seen: of it; seen is None for points alone. off: (N,)
    mm, how much nearer to the part the path is than it should be. force: (N,) N. way: (N,) mm along the path. seconds:
    of the robot, 0 where it is not known. found: s of the computer, from the photo or the scan on.
    """

    run: Run
    error: Error
    seen: Observed | None
    off: np.ndarray
    force: np.ndarray
    way: np.ndarray
    seconds: float
    found: float


def main(figures: bool, small: bool) -> None:
    places = of_paper(1 if small else 3, 1 if small else 10)
    routes: dict[str, list[Route]] = {CAD: [], EXACT: [], IMAGE: [], PIXELS: []}
    begins: list[complex] = []
    shown: list[tuple[camgen.Result, camgen.Result]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        moves = scanned(folder)
        for k, photo in enumerate(places):
            write(folder, photo)
            truth = offset_truth(photo.loops, photo.tool / 2)
            seen = {
                name: vision(folder, photo, planner)
                for name, planner in ((EXACT, "geometric"), (IMAGE, "image"))
            }
            for name, (result, spent) in seen.items():
                routes[name].append(judged(run(result.program), truth, result.cycle.total, spent))
            drawn, spent = by_drawing(folder, photo, k, FEW_POINTS if small else POINTS)
            routes[CAD].append(judged(drawn[0], truth, drawn[1] + moves, spent))
            pixels = paper_route(folder, photo.name, f"{photo.name}.png", truth)
            routes[PIXELS].append(judged(at_feed(pixels), truth, 0.0, 0.0, told=False))
            begins.append(complex(photo.loops[0].points[:2].mean()))
            shown.append((seen[EXACT][0], seen[IMAGE][0]))
    tilts = ", ".join(f"{photo.tilt:.1f}" for photo in places)
    print(f"{machine()}\n\nPlacements: {len(places)}, tilt {tilts} deg.")
    tell(routes, moves)
    if figures:
        draw(*shown[0], routes, begins)


def tell_feeds(small: bool) -> int:
    """A row a photo and planner. Of the small photos, in which an inner arc has five pixels, nothing is asked."""
    table = open_table(
        "photo | planner | off 5 % {:.2f} % | peak {:.2f} "
        "| without force mm {:.2f} | standing with force mm {:.2f}"
    )
    missed = False
    for photo in of_paper(1 if small else 10, 1 if small else 10):
        with tempfile.TemporaryDirectory() as scratch:
            write(Path(scratch), photo)
            truth = offset_truth(photo.loops, photo.tool / 2)
            for planner in ("geometric", "image"):
                seen = observe(run(vision(Path(scratch), photo, planner)[0].program), truth, FEED)
                missed |= seen.off5 > MOST_OFF and not small
                figures = 100 * seen.off5, seen.peak, seen.without, seen.too_much
                table.add(photo.name, planner, *figures)
    return int(missed)


def vision(folder: Path, photo: Photo, planner: str) -> tuple[camgen.Result, float]:
    """The program from the photo, and the seconds that it took."""
    file = folder / f"{photo.name}.png"
    job = load_job(folder / f"{photo.name}.toml", [f"operation.planner={planner}", *arm(photo)])
    return timed(lambda: camgen.build(file, post="pacscript", job=job))


def arm(photo: Photo) -> list[str]:
    """The paper's arm, the part before it."""
    middle = complex(photo.loops[0].points.mean())
    at = [BEFORE[0] - middle.real, BEFORE[1] - middle.imag, BEFORE[2], 0.0, 0.0, 0.0]
    return ["cell.robot=VS-6556", f"cell.base_from_work={at}"]


# -- the CAD route, as in section 4.3


def by_drawing(folder: Path, photo: Photo, k: int, points: int) -> tuple[tuple[Run, float], float]:
    """The drawing's program where ``camgen localize`` finds the part: its run and the robot's seconds; and those of the
    localization.
    """
    own = paper()
    turn = float(
        np.angle(
            (photo.loops[0].points[1] - photo.loops[0].points[0]) / np.diff(own[0].points[:2])[0]
        )
    )
    middle = complex(photo.loops[0].points[0] - own[0].points[0] * np.exp(1j * turn))
    model, cloud, frame = folder / "part.stl", folder / f"scan{k}.xyz", folder / f"frame{k}.toml"
    solid = sheet(own, THICK)
    solid.export(model)
    c, s = math.cos(turn), math.sin(turn)
    matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shift = np.array([middle.real, middle.imag, 0.0])
    np.savetxt(cloud, scan(solid, points, k, ROUND, NOISE, 0.2) @ matrix.T + shift, fmt="%.4f")
    place = middle.real + ABOUT[0], middle.imag - ABOUT[0], 0.0
    about = *place, 0.0, 0.0, math.degrees(turn) + ABOUT[1]
    start = f"--start={','.join(map(str, about))}"
    words = ["localize", str(model), str(cloud), "-o", str(frame), start, "-q"]
    failed, spent = timed(lambda: command(words))
    if failed:
        sys.exit(1)
    found = load_job(frame).cell.base_from_work
    assert found is not None
    pose = pose_from_values(found)
    result = camgen.build(drawing(folder, own), post="pacscript", job=drawn_job(photo))
    there = run(result.program)
    flat = np.column_stack([there.places.real, there.places.imag])
    places = flat @ pose.rotation[:2, :2].T + pose.origin[:2]
    moved = Run(places @ np.array([1, 1j]), there.speed, there.pressed, there.time)
    return (moved, result.cycle.total), spent


def drawing(folder: Path, loops: Sequence[Loop]) -> Path:
    """The part as a CAD program would draw it."""
    document = ezdxf.new("R2010", units=4)
    for loop in loops:
        rows = zip(
            loop.points.real.tolist(), loop.points.imag.tolist(), loop.bulges.tolist(), strict=True
        )
        document.modelspace().add_lwpolyline(list(rows), format="xyb", close=True)
    document.saveas(folder / "part.dxf")
    return folder / "part.dxf"


def drawn_job(photo: Photo) -> camgen.Job:
    return camgen.job({
        "tool": {"diameter": photo.tool}, "process": {"feed": FEED, "force": FORCE}, "post": {"force": "template"},
        "cell": {"robot": "VS-6556", "base_from_work": [*BEFORE, 0.0, 0.0, 0.0]},
    })  # fmt: skip


def scanned(folder: Path) -> float:
    """Seconds in which the arm takes the scanner over the part once, from its rest and back."""
    document = ezdxf.new("R2010", units=4)
    half = 1.5 * 25.4 + BEYOND
    document.modelspace().add_line((-half, 0), (half, 0))
    document.saveas(folder / "scan.dxf")
    job = {"process": {"feed": SCAN_FEED}, "operation": {"kind": "trace"},
           "cell": {"robot": "VS-6556", "base_from_work": [*BEFORE, 0.0, 0.0, 0.0]}}  # fmt: skip
    return camgen.build(folder / "scan.dxf", post="pacscript", job=job).cycle.total


# -- what came out


def at_feed(points: np.ndarray) -> Run:
    """Points alone, run at the nominal feed and pressed all the way."""
    step = np.abs(np.diff(points, append=points[-1]))
    whole = np.ones(len(points))
    return Run(points, FEED * whole, whole > 0, step / FEED)


def judged(found: Run, truth: Truth, seconds: float, spent: float, told: bool = True) -> Route:
    """told: the feed is the route's own."""
    nearness = truth.distance - truth.part.distance(found.places)
    force, _ = pressed(nearness, np.where(found.pressed, FORCE, 0.0), found.time, Contact())
    way = np.append(0.0, np.cumsum(np.abs(np.diff(found.places))))
    seen = observe(found, truth, FEED) if told else None
    return Route(
        found, path_error(found.places[::4], truth), seen, nearness, force, way, seconds, spent
    )


def settled(route: Route) -> np.ndarray:
    """Force where it has been asked for over ``SETTLED`` mm."""
    on = route.run.pressed
    since = route.way - np.maximum.accumulate(np.where(on, -np.inf, route.way))
    return route.force[on & (since > SETTLED) & (route.way > SETTLED)]


def tell(routes: dict[str, list[Route]], moves: float) -> None:
    table = Table(
        "route | max mm {:.4f} | rms mm {:.4f} | at sharp corners max mm {:.4f} "
        "| contact off 5 % {:.2f} % | peak of the feed {:.2f} | contact without force mm {:.2f} "
        "| standing with force mm {:.2f}"
    )
    for name, found in routes.items():
        error = [one.error for one in found]
        rms = math.sqrt(np.mean([one.rms**2 for one in error]))
        near = max(one.near for one in error)
        table.add(name, max(one.most for one in error), rms, near, *feeds(found))
    heads = " | ".join(f"{name} {{:.3f}}" for name in routes)
    table = Table(f"at each place: largest error mm | {heads}")
    for k in range(len(routes[CAD])):
        table.add(k + 1, *(found[k].error.most for found in routes.values()))
    table = Table(f"force, of 2 N | {heads}")
    forces = [np.concatenate([settled(one) for one in found]) - FORCE for found in routes.values()]
    table.add("off rms, N", *(f"{math.sqrt(np.mean(off**2)):.4f}" for off in forces))
    table.add("off at most, N", *(np.abs(off).max() for off in forces))
    timed_routes = [routes[name] for name in (CAD, EXACT, IMAGE)]
    robot = [np.mean([one.seconds for one in found]) for found in timed_routes]
    table = Table(f"time, s | {CAD} {{:.1f}} | {EXACT} {{:.1f}} | {IMAGE} {{:.1f}}")
    table.add("deburring", robot[0] - moves, *robot[1:])
    table.add("the scan", moves, "0", "0")
    table.add("the computer", *(np.mean([one.found for one in found]) for found in timed_routes))


def feeds(found: list[Route]) -> list[float]:
    """The worst shares and lengths of the feed; none for a route of points alone."""
    seen = [one.seen for one in found if one.seen is not None]
    if not seen:
        return []
    lengths = [(one.peak, one.without, one.too_much) for one in seen]
    return [100 * max(one.off5 for one in seen), *np.max(lengths, axis=0)]


def draw(
    exact: camgen.Result,
    image: camgen.Result,
    routes: dict[str, list[Route]],
    begins: list[complex],
) -> None:
    if exact.part.raster is not None:
        stages = svg(
            exact.part,
            exact.part.raster,
            exact.tour,
            exact.notes,
            "3 x 2.5 in part, from photo to path",
        )
        (IMAGES / "pist-stages.svg").write_text(stages)
    (IMAGES / "pist-contacts.svg").write_text(
        contacts(image.part, image.tour.paths[0], 3 / 16 * 25.4)
    )
    (IMAGES / "pist-frames.svg").write_text(frames(exact.part, exact.tour.paths[0]))
    rows = {
        name: [series(*one) for one in zip(found, begins, strict=True)]
        for name, found in routes.items()
    }
    (IMAGES / "pist-error.svg").write_text(errors(rows, FORCE))


def series(route: Route, begin: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance along the path from where it passes the middle of the drawing's first side; error; force."""
    first = int(np.abs(route.run.places - begin).argmin())
    way = np.append(
        route.way[first:] - route.way[first], route.way[:first] + route.way[-1] - route.way[first]
    )
    return way, np.roll(route.off, -first), np.roll(route.force, -first)


if __name__ == "__main__":
    if "--feed" in sys.argv:
        sys.exit(tell_feeds("--small" in sys.argv))
    main("--figures" in sys.argv, "--small" in sys.argv)
