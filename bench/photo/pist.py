"""The case study of docs/pist.md: python -m bench.photo.pist [--figures] [--small]

--figures: the page's pictures are drawn again. --small: with a tenth of the pixels, for a try.

The paper's part (3 x 2.5 in, tool 3/8 in, 5 mm/s, 2 N) is rendered as its camera would see it, and drawn as DXF. Both
go through camgen for a Denso controller. What the planned programs do is compared with the exact path, and with the
path of the CAD route.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import ezdxf
import numpy as np

import camgen
from bench.machine import machine
from bench.photo.paper import paper_route
from bench.photo.photo import planned
from bench.render.photos import photos, write
from bench.render.shapes import Loop
from bench.render.truth import Truth, offset_truth, path_error
from camgen.cli import main as run
from camgen.preview.photo_stages import svg
from camgen.read.job_file import load

IMAGES = Path(__file__).parents[2] / "docs" / "images"
#: mm: half the height of a row of the error picture; what counts as near a sharp corner.
SCALE, NEAR = 0.25, 1.0
STYLE = """.bg{fill:#fff}text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}
.tick{font-size:2.4px;text-anchor:end}path{fill:none}.frame{stroke:#9aa0a6;stroke-width:.2}
.line{stroke:#1f6feb;stroke-width:.35}@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}}"""


def main(figures: bool, small: bool) -> None:
    photo = photos(1, 1 if small else 10)[0]
    truth = offset_truth(photo.loops, photo.tool / 2)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write(folder, photo)
        file, job = folder / f"{photo.name}.png", folder / f"{photo.name}.toml"
        paths = {
            "photo, geometric planner": path(file, job, "operation.planner=geometric"),
            "photo, image-space planner": path(file, job, "operation.planner=image"),
            "photo, whole pixels as in the paper": paper_route(folder, photo.name, file.name, truth),
            "drawing (CAD)": path(drawing(folder, photo.loops), without_camera(job), "tool.orient=fixed"),
        }
        seen = camgen.build(file, post="pacscript", job=load(job))
    cad = paths["drawing (CAD)"]
    print(f"{machine()}\n\nTilt {photo.tilt:.1f} deg, {seen.part.units}, tool {photo.tool:.3f} mm.\n")
    print("| route | max mm | rms mm | at sharp corners max mm | from the CAD route rms mm |\n|---|---|---|---|---|")
    for name, points in paths.items():
        error = path_error(points, truth)
        apart = "" if points is cad else f"{apart_from(points, cad, truth):.4f}"
        print(f"| {name} | {error.most:.4f} | {error.rms:.4f} | {error.near:.4f} | {apart} |")
    if figures and seen.part.raster is not None:
        title = "3 x 2.5 in part, from photo to path"
        (IMAGES / "pist-stages.svg").write_text(svg(seen.part, seen.part.raster, seen.tour, seen.notes, title))
        (IMAGES / "pist-error.svg").write_text(drawn(paths, truth))


def path(source: Path, job: Path, setting: str) -> np.ndarray:
    """Points of the planned program while the tool works, complex, mm."""
    plan = source.with_suffix(".json")
    words = ["build", str(source), "--post", "pacscript", "--job", str(job), "--set", setting, "-q"]
    if run([*words, "-o", str(source.parent), "--plan", str(plan)]):
        sys.exit(1)
    return planned(plan)


def without_camera(job: Path) -> Path:
    """The tables of a job that a drawing uses as well."""
    own = job.with_name("drawing.toml")
    own.write_text(job.read_text().partition("[camera]")[0] + "[tool]" + job.read_text().partition("[tool]")[2])
    return own


def drawing(folder: Path, loops: Sequence[Loop]) -> Path:
    """The part as a CAD program would draw it."""
    document = ezdxf.new("R2010", units=4)
    for loop in loops:
        rows = zip(loop.points.real.tolist(), loop.points.imag.tolist(), loop.bulges.tolist(), strict=True)
        document.modelspace().add_lwpolyline(list(rows), format="xyb", close=True)
    document.saveas(folder / "part.dxf")
    return folder / "part.dxf"


def apart_from(points: np.ndarray, other: np.ndarray, truth: Truth) -> float:
    """How far apart two paths are, rms, away from sharp corners: by their distances from the part at nearest points."""
    sharp = truth.points[truth.sharp]
    a, b = (truth.part.distance(path) for path in (points, other))
    apart = []
    for k in range(0, len(points), 256):
        here = points[k : k + 256, None]
        calm = np.abs(here - sharp).min(axis=1, initial=np.inf) > NEAR
        nearest = np.abs(here[calm] - other).argmin(axis=1)
        apart.append(a[k : k + 256][calm] - b[nearest])
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def drawn(paths: dict[str, np.ndarray], truth: Truth) -> str:
    """The error across each path as SVG, a row a route, by the angle at which it is seen from the part's middle."""
    wide, high, left = 250.0, 22.0, 14.0
    lines = []
    for k, (name, points) in enumerate(paths.items()):
        turn = np.angle(points - truth.points.mean())
        rank = np.argsort(turn)
        off = (truth.part.distance(points) - truth.distance)[rank].clip(-SCALE, SCALE)
        top = 18 + k * (high + 8)
        x, y = left + (turn[rank] / np.pi + 1) / 2 * wide, top + high / 2 - off / SCALE * high / 2
        data = "M" + "L".join(f"{a:.1f} {b:.2f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        lines += [
            f'<text x="{left}" y="{top - 1.5}">{name}</text>',
            f'<path class="frame" d="M{left} {top}h{wide}v{high}h-{wide}zM{left} {top + high / 2}h{wide}"/>',
            f'<path class="line" d="{data}"/>',
            f'<text class="tick" x="{left - 1}" y="{top + 2}">+{SCALE}</text>',
            f'<text class="tick" x="{left - 1}" y="{top + high}">-{SCALE}</text>',
        ]
    total = 18 + len(paths) * (high + 8)
    size = f'width="270mm" height="{total}mm" viewBox="0 0 270 {total}"'
    title = "error of the tool centre across the path, mm, once around the part"
    head = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', f"<style>{STYLE}</style>"]
    head += ['<rect class="bg" width="100%" height="100%"/>', f'<text x="{left}" y="8">{title}</text>']
    return "\n".join([*head, *lines, "</svg>\n"])


if __name__ == "__main__":
    main("--figures" in sys.argv, "--small" in sys.argv)
