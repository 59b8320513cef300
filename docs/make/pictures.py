"""The pictures of the pages on operations, from the previews of camgen.

    python -m docs.make.pictures [FOLDER]      writes them into FOLDER (default: docs/images)

A picture is the preview of a fixture: `camgen build INPUT --preview X.svg`, or X.png. The pictures
page*.png are pages (X.html) in Chromium; without Chromium they are not changed.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.pipeline import Result, build
from camgen.preview import page as html
from camgen.preview import png as picture
from camgen.preview import view
from camgen.preview.drawings import draw_preview
from camgen.preview.fixtures import clip_fixtures
from camgen.preview.svg import DrawnFixtures, format_svg

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
#: The G-code of the bracket, as an old program.
OLD = ROOT / "fixtures" / "cases" / "bracket-follow" / "expected" / "part.ngc"
#: A plate that is cut out, with tabs.
TABS = ROOT / "fixtures" / "cases" / "bracket-tabs" / "job.toml"
#: Width of a PNG, px, and shades of a channel. Both keep the files small.
_WIDTH, _SHADES = 760, 10
#: Rows and columns of the scene in a picture of the page: below the title, above the slider, beside
#: the list.
_SCENE = (slice(46, -68), slice(430, None))
#: Switches of a browser that draws with the processor, and waits until the page no longer changes.
_SWITCHES = (
    *(
        "--headless",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--hide-scrollbars",
    ),
    *("--virtual-time-budget=8000", "--window-size=1100,700"),
)


def read_job(page: str, name: str) -> dict[str, object]:
    """The job file that a page of docs/ shows."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    block = text.partition(f"`{name}`:\n\n```toml\n")[2].partition("```")[0]
    return tomllib.loads(block)


class PictureSpec(Struct, frozen=True):
    """A picture and its build.

    name: name of the picture; "page" at its start means the page of the preview.
    source: input of the build.
    post: name of the post.
    job: job of the build, or its file.
    title: title of the picture, "" for the names of input and post.
    scene: whether only the scene of the page is shown.
    """

    name: str
    source: Path
    post: str
    job: Mapping[str, object] | Path = {}
    title: str = ""
    scene: bool = False


_MILL = {"tool": {"diameter": 5.0}, "process": {"spindle": 9000}}

#: A motor plate with three tools, which docs/preview.md shows.
PLATE = PARTS.parent / "cases" / "motor-plate" / "job.toml"
PICTURES = (
    PictureSpec("bracket.svg", PARTS / "bracket.dxf", "rapid"),
    PictureSpec("trace.svg", PARTS / "bracket.dxf", "vplus", {"operation": {"kind": "trace"}}),
    PictureSpec("tabs.svg", PARTS / "bracket.dxf", "gcode", TABS),
    PictureSpec("space.svg", PARTS / "space.dxf", "rapid", {"operation": {"kind": "trace"}}),
    PictureSpec(
        "fill.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "fill"}, "tool": {"diameter": 3.0}},
    ),
    PictureSpec(
        "pocket.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "pocket", "depth": 2, "entry": "helix"}, **_MILL},
    ),
    PictureSpec(
        "bore.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "bore", "depth": 4, "entry": "helix"}, **_MILL},
    ),
    PictureSpec(
        "chamfer.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {
            "operation": {"kind": "chamfer", "width": 1},
            "tool": {"kind": "v"},
            "process": {"spindle": 9000},
        },
    ),
    PictureSpec(
        "drill.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {
            "operation": {"kind": "drill", "depth": 4},
            "tool": {"kind": "drill", "diameter": 8.0},
            "process": {"spindle": 1200, "feed": 2},
        },
    ),
    PictureSpec(
        "replay.svg", OLD, "rapid", {"post": {"signals": {"dout0": "doProcess"}}}, "old.ngc, rapid"
    ),
    PictureSpec("edges.png", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1.toml"),
    PictureSpec("rfa1-order.svg", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1_nominal.toml"),
    PictureSpec("rfa2-order.svg", PARTS / "rfa2.stl", "rapid", PARTS / "rfa2_nominal.toml"),
    PictureSpec("page.png", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1.toml"),
    PictureSpec(
        "page-photo.png",
        PARTS / "gear.png",
        "pacscript",
        {"image": {"width_mm": 100.0}},
        scene=True,
    ),
    PictureSpec("page-cut.png", PARTS / "motor.dxf", "gcode", PLATE, scene=True),
    PictureSpec("clamps.svg", PARTS / "motor.dxf", "grbl", read_job("first-day.md", "shop.toml")),
    PictureSpec(
        "page-clamps.png",
        PARTS / "motor.dxf",
        "grbl",
        read_job("first-day.md", "shop.toml"),
        scene=True,
    ),
)


def shrink(image: bytes) -> bytes:
    """A narrower PNG of a picture, with fewer shades."""
    pixels = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)
    height = round(pixels.shape[0] * _WIDTH / pixels.shape[1])
    pixels = cv2.resize(pixels, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    return reduce_shades(pixels, _SHADES)


def reduce_shades(pixels: NDArray[np.uint8], shades: int) -> bytes:
    """A PNG with this number of shades of each channel."""
    step = 255 / (shades - 1)
    rounded = np.round(np.round(pixels / step) * step).astype(np.uint8)
    return bytes(cv2.imencode(".png", rounded, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


def shoot_page(result: Result, scene: bool) -> bytes:
    """A PNG of the preview page in Chromium without a window, b"" without Chromium."""
    browser = shutil.which("chromium")
    if not browser:
        return b""
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name, "page.html"), Path(name, "page.png")
        source.write_text(html.format_page(view.make_view(result)), encoding="utf-8")
        command = [browser, *_SWITCHES, f"--screenshot={target}", source.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        if not scene:
            return shrink(target.read_bytes())
        pixels = cv2.imdecode(np.frombuffer(target.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
        return reduce_shades(pixels[_SCENE], 2 * _SHADES)


def draw(spec: PictureSpec) -> bytes:
    """The bytes of a picture, b"" if a page needs Chromium and it is missing."""
    result: Result = build(spec.source, post=spec.post, job=spec.job)
    if spec.name.startswith("page"):
        return shoot_page(result, spec.scene)
    if spec.name.endswith(".png"):
        return shrink(picture.draw_png(view.make_view(result)))
    if result.part.solid is not None:
        return draw_preview(result, Path(spec.name))
    title = spec.title or f"{spec.source.name}, {spec.post}"
    drawn_fixtures = DrawnFixtures(clip_fixtures(result), result.blocked)
    return format_svg(
        result.part, result.tour, result.notes, title, standing=drawn_fixtures
    ).encode()


def main(folder: Path) -> None:
    """Writes all pictures into a folder."""
    for spec in PICTURES:
        data = draw(spec)
        if not data:
            print(f"{spec.name}: not renewed, no chromium")
            continue
        (folder / spec.name).write_bytes(data)
        print(f"{spec.name}: {len(data) / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images")
