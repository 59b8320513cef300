"""The case study of docs/pist.md.

    python -m bench.photo.pist [--figures] [--small]
    python -m bench.photo.pist --feed [--small]

The first command prints the results of the paper; --figures draws the pictures of the page. The
second prints the observed feed and the force on ten photos by both planners; its exit code is 1 if
the feed is more than 5 % off in more than 2 % of the contact. --small: one photo with a tenth of
the pixels, for a try.

The paper's part (3 x 2.5 in, tool 3/8 in, 5 mm/s, 2 N) lies at three places. The vision route: a
photo is rendered for each place as the paper's camera would see it, and built for a Denso
controller. The CAD route is the paper's: a drawing is planned once, the clamped part is scanned,
``camgen localize`` locates it, and the path is moved there. The motions of the programs are
compared with the exact path. A model of the contact (bench/photo/contact.py) gives the force.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import numpy as np

import camgen
from bench.photo.contact import Contact, simulate_force
from bench.photo.observed import Observed, Run, observe, sample_program
from bench.photo.paper import paper_route
from bench.photo.pist_figures import contacts, errors, frames
from bench.render.parts import paper
from bench.render.photos import Photo, of_paper, write
from bench.render.solid import sheet
from bench.render.truth import Error, Truth, offset_truth, path_error
from bench.support.runner import ROOT, Table, machine, open_table
from bench.support.timing import timed
from camgen.cli import main as command
from camgen.model.pose import pose_from_values
from camgen.preview.photo_stages import svg
from camgen.read.job_file import load_job
from tests.support.clouds import ROUND, scan
from tests.support.part_photos import write_dxf

IMAGES = ROOT / "docs" / "images"
#: Feed, mm/s, and force, N, of the paper.
FEED, FORCE = 5.0, 2.0
#: Thickness of the sheet and noise of the scanner, mm.
THICK, NOISE = 2.0, 0.05
#: Error of the start that `localize` is given: mm in x and y, and deg.
START_ERROR, START_TURN = 5.0, 4.0
#: Points of the scan, without and with `--small`.
POINTS, FEW_POINTS = 50_000, 5_000
#: The scanner runs over the part and beyond its ends: the distance, mm, and the speed, mm/s.
BEYOND, SCAN_FEED = 20.0, 10.0
#: Middle of the part in the frame of the arm, mm.
MIDDLE = (350.0, 0.0, 150.0)
CAD, EXACT = "drawing, scan, localize", "photo, geometric"
IMAGE, PIXELS = "photo, image space", "photo, whole pixels"
#: Share of the contact in which the feed may be more than 5 % off.
MAX_OFF = 0.02
#: Length of the path after the start of the force in which the force is not compared, mm.
SETTLED = 8.0


@dataclass(frozen=True, eq=False)
class Route:
    """One route at one place.

    run: its program.
    error: error of the path.
    observed: feed of the contact point, None for points without a feed.
    deviation: (N,) mm, distance by which the path is too near to the part.
    force: (N,) N.
    along: (N,) mm, length of the path up to each point.
    robot: time of the robot, s, 0 if it is unknown.
    computer: time of the computer from the photo or the scan on, s.
    """

    run: Run
    error: Error
    observed: Observed | None
    deviation: np.ndarray
    force: np.ndarray
    along: np.ndarray
    robot: float
    computer: float


def main(figures: bool, small: bool) -> None:
    """Prints the results of the paper. figures: draws the pictures, too."""
    photos = of_paper(1 if small else 3, 1 if small else 10)
    routes: dict[str, list[Route]] = {CAD: [], EXACT: [], IMAGE: [], PIXELS: []}
    starts: list[complex] = []
    results: list[tuple[camgen.Result, camgen.Result]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        scan_time = measure_scan(folder)
        for k, photo in enumerate(photos):
            write(folder, photo)
            truth = offset_truth(photo.loops, photo.tool / 2)
            built = []
            for name, planner in ((EXACT, "geometric"), (IMAGE, "image")):
                result, spent = build_photo(folder, photo, planner)
                built.append(result)
                run = sample_program(result.program)
                routes[name].append(measure_route(run, truth, result.cycle.total, spent))
            run, robot, spent = run_drawing(folder, photo, k, FEW_POINTS if small else POINTS)
            routes[CAD].append(measure_route(run, truth, robot + scan_time, spent))
            pixels = paper_route(folder, photo.name, f"{photo.name}.png", truth)
            routes[PIXELS].append(measure_route(run_at_feed(pixels), truth, has_feed=False))
            starts.append(complex(photo.loops[0].points[:2].mean()))
            results.append((built[0], built[1]))
    tilts = ", ".join(f"{photo.tilt:.1f}" for photo in photos)
    print(f"{machine()}\n\nPlacements: {len(photos)}, tilt {tilts} deg.")
    print_tables(routes, scan_time)
    if figures:
        draw(*results[0], routes, starts)


def print_feeds(small: bool) -> int:
    """Prints a row per photo and planner.

    The small photos have no goal: an inner arc has five pixels there.
    """
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
                result, _ = build_photo(Path(scratch), photo, planner)
                observed = observe(sample_program(result.program), truth, FEED)
                missed |= observed.off5 > MAX_OFF and not small
                figures = 100 * observed.off5, observed.peak, observed.without, observed.too_much
                table.add(photo.name, planner, *figures)
    return int(missed)


def build_photo(folder: Path, photo: Photo, planner: str) -> tuple[camgen.Result, float]:
    """Builds the photo for the paper's arm. Returns the result and the seconds of the build."""
    file = folder / f"{photo.name}.png"
    middle = complex(photo.loops[0].points.mean())
    frame = [MIDDLE[0] - middle.real, MIDDLE[1] - middle.imag, MIDDLE[2], 0.0, 0.0, 0.0]
    words = [
        f"operation.planner={planner}", "cell.robot=VS-6556", f"cell.base_from_work={frame}"
    ]  # fmt: skip
    job = load_job(folder / f"{photo.name}.toml", words)
    return timed(lambda: camgen.build(file, post="pacscript", job=job))


# -- the CAD route, as in section 4.3


def run_drawing(folder: Path, photo: Photo, k: int, points: int) -> tuple[Run, float, float]:
    """Runs the drawing's program where ``camgen localize`` locates the part.

    Returns the run, the seconds of the robot, and those of the localization.
    """
    loops = paper()
    drawn, placed = loops[0].points, photo.loops[0].points
    turn = float(np.angle((placed[1] - placed[0]) / np.diff(drawn[:2])[0]))
    origin = complex(placed[0] - drawn[0] * np.exp(1j * turn))
    model, cloud, frame = folder / "part.stl", folder / f"scan{k}.xyz", folder / f"frame{k}.toml"
    solid = sheet(loops, THICK)
    solid.export(model)
    c, s = math.cos(turn), math.sin(turn)
    matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shift = np.array([origin.real, origin.imag, 0.0])
    np.savetxt(cloud, scan(solid, points, k, ROUND, NOISE, 0.2) @ matrix.T + shift, fmt="%.4f")
    angle = math.degrees(turn) + START_TURN
    values = origin.real + START_ERROR, origin.imag - START_ERROR, 0.0, 0.0, 0.0, angle
    start = f"--start={','.join(map(str, values))}"
    words = ["localize", str(model), str(cloud), "-o", str(frame), start, "-q"]
    failed, spent = timed(lambda: command(words))
    if failed:
        sys.exit(1)
    located = load_job(frame).cell.base_from_work
    assert located is not None
    pose = pose_from_values(located)
    result = camgen.build(
        write_dxf(folder / "part.dxf", loops), post="pacscript", job=make_job(photo)
    )
    run = sample_program(result.program)
    flat = np.column_stack([run.places.real, run.places.imag])
    places = flat @ pose.rotation[:2, :2].T + pose.origin[:2]
    moved = Run(places @ np.array([1, 1j]), run.speed, run.pressed, run.time)
    return moved, result.cycle.total, spent


def make_job(photo: Photo) -> camgen.Job:
    """The job of the drawing."""
    return camgen.job({
        "tool": {"diameter": photo.tool}, "post": {"force": "template"},
        "process": {"feed": FEED, "force": FORCE},
        "cell": {"robot": "VS-6556", "base_from_work": [*MIDDLE, 0.0, 0.0, 0.0]},
    })  # fmt: skip


def measure_scan(folder: Path) -> float:
    """Seconds in which the arm moves the scanner over the part once, from its rest and back."""
    document = ezdxf.new("R2010", units=4)
    half = 1.5 * 25.4 + BEYOND
    document.modelspace().add_line((-half, 0), (half, 0))
    document.saveas(folder / "scan.dxf")
    job = {"process": {"feed": SCAN_FEED}, "operation": {"kind": "trace"},
           "cell": {"robot": "VS-6556", "base_from_work": [*MIDDLE, 0.0, 0.0, 0.0]}}  # fmt: skip
    return camgen.build(folder / "scan.dxf", post="pacscript", job=job).cycle.total


# -- results


def run_at_feed(points: np.ndarray) -> Run:
    """Points, run at the nominal feed and pressed from start to end."""
    step = np.abs(np.diff(points, append=points[-1]))
    whole = np.ones(len(points))
    return Run(points, FEED * whole, whole > 0, step / FEED)


def measure_route(
    run: Run, truth: Truth, robot: float = 0.0, computer: float = 0.0, has_feed: bool = True
) -> Route:
    """Compares a run with the exact path.

    robot, computer: their seconds.
    has_feed: whether the route sets the feed itself.
    """
    deviation = truth.distance - truth.part.distance(run.places)
    force = simulate_force(deviation, np.where(run.pressed, FORCE, 0.0), run.time, Contact())[0]
    along = np.append(0.0, np.cumsum(np.abs(np.diff(run.places))))
    observed = observe(run, truth, FEED) if has_feed else None
    error = path_error(run.places[::4], truth)
    return Route(run, error, observed, deviation, force, along, robot, computer)


def list_settled(route: Route) -> np.ndarray:
    """The force at points at which it has been set for more than ``SETTLED`` mm, N."""
    pressed = route.run.pressed
    since = route.along - np.maximum.accumulate(np.where(pressed, -np.inf, route.along))
    return route.force[pressed & (since > SETTLED) & (route.along > SETTLED)]


def print_tables(routes: dict[str, list[Route]], scan_time: float) -> None:
    """Prints the tables of the paper's results."""
    table = Table(
        "route | max mm {:.4f} | rms mm {:.4f} | at sharp corners max mm {:.4f} "
        "| contact off 5 % {:.2f} % | peak of the feed {:.2f} | contact without force mm {:.2f} "
        "| standing with force mm {:.2f}"
    )
    for name, placed in routes.items():
        errors = [route.error for route in placed]
        rms = math.sqrt(np.mean([error.rms**2 for error in errors]))
        near = max(error.near for error in errors)
        table.add(name, max(error.largest for error in errors), rms, near, *summarise_feeds(placed))
    heads = " | ".join(f"{name} {{:.3f}}" for name in routes)
    table = Table(f"at each place: largest error mm | {heads}")
    for k in range(len(routes[CAD])):
        table.add(k + 1, *(placed[k].error.largest for placed in routes.values()))
    table = Table(f"force, of 2 N | {heads}")
    errors = []
    for placed in routes.values():
        errors.append(np.concatenate(list(map(list_settled, placed))) - FORCE)
    table.add("off rms, N", *(f"{math.sqrt(np.mean(error**2)):.4f}" for error in errors))
    table.add("off at most, N", *(np.abs(error).max() for error in errors))
    timed_routes = [routes[name] for name in (CAD, EXACT, IMAGE)]
    robot, computer = [], []
    for placed in timed_routes:
        robot.append(np.mean([route.robot for route in placed]))
        computer.append(np.mean([route.computer for route in placed]))
    table = Table(f"time, s | {CAD} {{:.1f}} | {EXACT} {{:.1f}} | {IMAGE} {{:.1f}}")
    table.add("deburring", robot[0] - scan_time, *robot[1:])
    table.add("the scan", scan_time, "0", "0")
    table.add("the computer", *computer)


def summarise_feeds(routes: list[Route]) -> list[float]:
    """The worst shares and lengths of the feed. Empty for routes without a feed."""
    observed = [route.observed for route in routes if route.observed is not None]
    if not observed:
        return []
    values = [(100 * each.off5, each.peak, each.without, each.too_much) for each in observed]
    return np.max(values, axis=0).tolist()


def draw(
    exact: camgen.Result,
    image: camgen.Result,
    routes: dict[str, list[Route]],
    starts: list[complex],
) -> None:
    """Draws the pictures of docs/pist.md. starts: start of the curves of each place, mm."""
    raster, title = exact.part.raster, "3 x 2.5 in part, from photo to path"
    assert raster is not None
    stages = svg(exact.part, raster, exact.tour, exact.notes, title)
    touches = contacts(image.part, image.tour.paths[0], 3 / 16 * 25.4)
    rows = {}
    for name, placed in routes.items():
        pairs = zip(placed, starts, strict=True)
        rows[name] = [list_series(route, start) for route, start in pairs]
    pictures = {
        "stages": stages,
        "contacts": touches,
        "frames": frames(exact.part, exact.tour.paths[0]),
        "error": errors(rows, FORCE),
    }
    for name, picture in pictures.items():
        (IMAGES / f"pist-{name}.svg").write_text(picture)


def list_series(route: Route, start: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Length of the path, deviation and force at its points, from the point nearest to `start`."""
    first = int(np.abs(route.run.places - start).argmin())
    rest = route.along[:first] + route.along[-1]
    along = np.append(route.along[first:], rest) - route.along[first]
    return along, np.roll(route.deviation, -first), np.roll(route.force, -first)


if __name__ == "__main__":
    if "--feed" in sys.argv:
        sys.exit(print_feeds("--small" in sys.argv))
    main("--figures" in sys.argv, "--small" in sys.argv)
