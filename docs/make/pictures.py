"""The pictures of the pages on operations, from camgen's own previews.

    python -m docs.make.pictures [FOLDER]      writes them into FOLDER (default: docs/images)

Every picture is what ``camgen build INPUT --preview X.svg`` or ``.png`` draws of a fixture. page.png, page-photo.png
and page-cut.png are pages of ``--preview X.html`` in Chromium; without one they stay as they are.
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
#: The G-code of the bracket, as a program that somebody kept.
OLD = ROOT / "fixtures" / "cases" / "bracket-follow" / "expected" / "part.ngc"
#: A plate that is cut out, with what holds it.
TABS = ROOT / "fixtures" / "cases" / "bracket-tabs" / "job.toml"
#: Width of a PNG, and the colours of a channel: small files.
_WIDE, _SHADES = 760, 10
#: Of a picture of the page: beside the list, below the title and above the slider.
_SCENE = (slice(46, -68), slice(430, None))
#: A browser that draws with the processor, and waits until the page has come to rest.
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
    """The job file that a page shows."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    block = text.partition(f"`{name}`:\n\n```toml\n")[2].partition("```")[0]
    return tomllib.loads(block)


class Shown(Struct, frozen=True):
    """One picture: what is built for it. source: the file in the title, where it is a copy. scene: of a page only what
    lies in space.
    """

    name: str
    source: Path
    post: str
    job: Mapping[str, object] | Path = {}
    title: str = ""
    scene: bool = False


_MILL = {"tool": {"diameter": 5.0}, "process": {"spindle": 9000}}

#: A motor plate with three tools, as docs/preview.md shows it.
PLATE = PARTS.parent / "cases" / "motor-plate" / "job.toml"
PICTURES = (
    Shown("bracket.svg", PARTS / "bracket.dxf", "rapid"),
    Shown("trace.svg", PARTS / "bracket.dxf", "vplus", {"operation": {"kind": "trace"}}),
    Shown("tabs.svg", PARTS / "bracket.dxf", "gcode", TABS),
    Shown("space.svg", PARTS / "space.dxf", "rapid", {"operation": {"kind": "trace"}}),
    Shown(
        "fill.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "fill"}, "tool": {"diameter": 3.0}},
    ),
    Shown(
        "pocket.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "pocket", "depth": 2, "entry": "helix"}, **_MILL},
    ),
    Shown(
        "bore.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {"operation": {"kind": "bore", "depth": 4, "entry": "helix"}, **_MILL},
    ),
    Shown(
        "chamfer.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {
            "operation": {"kind": "chamfer", "width": 1},
            "tool": {"kind": "v"},
            "process": {"spindle": 9000},
        },
    ),
    Shown(
        "drill.svg",
        PARTS / "bracket.dxf",
        "gcode",
        {
            "operation": {"kind": "drill", "depth": 4},
            "tool": {"kind": "drill", "diameter": 8.0},
            "process": {"spindle": 1200, "feed": 2},
        },
    ),
    Shown(
        "replay.svg", OLD, "rapid", {"post": {"signals": {"dout0": "doProcess"}}}, "old.ngc, rapid"
    ),
    Shown("edges.png", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1.toml"),
    Shown("rfa1-order.svg", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1_nominal.toml"),
    Shown("rfa2-order.svg", PARTS / "rfa2.stl", "rapid", PARTS / "rfa2_nominal.toml"),
    Shown("page.png", PARTS / "rfa1.stl", "rapid", PARTS / "rfa1.toml"),
    Shown(
        "page-photo.png",
        PARTS / "gear.png",
        "pacscript",
        {"image": {"width_mm": 100.0}},
        scene=True,
    ),
    Shown("page-cut.png", PARTS / "motor.dxf", "gcode", PLATE, scene=True),
    Shown("clamps.svg", PARTS / "motor.dxf", "grbl", read_job("first-day.md", "shop.toml")),
    Shown(
        "page-clamps.png",
        PARTS / "motor.dxf",
        "grbl",
        read_job("first-day.md", "shop.toml"),
        scene=True,
    ),
)


def small(image: bytes) -> bytes:
    """A picture of camgen, narrower and with fewer shades."""
    pixels = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)
    high = round(pixels.shape[0] * _WIDE / pixels.shape[1])
    pixels = cv2.resize(pixels, (_WIDE, high), interpolation=cv2.INTER_AREA)
    return coarse(pixels, _SHADES)


def coarse(pixels: NDArray[np.uint8], shades: int) -> bytes:
    """A PNG with so many shades of each colour."""
    step = 255 / (shades - 1)
    rounded = np.round(np.round(pixels / step) * step).astype(np.uint8)
    return bytes(cv2.imencode(".png", rounded, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


def page(result: Result, scene: bool) -> bytes:
    """The preview page as a headless Chromium shows it."""
    browser = shutil.which("chromium")
    if not browser:
        return b""
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name, "page.html"), Path(name, "page.png")
        source.write_text(html.format_page(view.make_view(result)), encoding="utf-8")
        command = [browser, *_SWITCHES, f"--screenshot={target}", source.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        if not scene:
            return small(target.read_bytes())
        shown = cv2.imdecode(np.frombuffer(target.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
        return coarse(shown[_SCENE], 2 * _SHADES)


def drawn(shown: Shown) -> bytes:
    """The bytes of one picture."""
    result: Result = build(shown.source, post=shown.post, job=shown.job)
    if shown.name.startswith("page"):
        return page(result, shown.scene)
    if shown.name.endswith(".png"):
        return small(picture.draw_png(view.make_view(result)))
    if result.part.solid is not None:
        return draw_preview(result, Path(shown.name))
    title = shown.title or f"{shown.source.name}, {shown.post}"
    standing = DrawnFixtures(clip_fixtures(result), result.blocked)
    return format_svg(result.part, result.tour, result.notes, title, standing=standing).encode()


def main(folder: Path) -> None:
    for shown in PICTURES:
        data = drawn(shown)
        if not data:
            print(f"{shown.name}: not renewed, no chromium")
            continue
        (folder / shown.name).write_bytes(data)
        print(f"{shown.name}: {len(data) / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images")
