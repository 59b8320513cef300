"""Pictures of the preview page, for an examination by eye: light, dark, narrow, large, with an arm.

    python -m docs.make.screens FOLDER [NAME ...]      writes NAME.png, all pictures without a name

playwright and a Chromium are needed. The processor draws the pictures.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from msgspec import Struct
from playwright.sync_api import Browser, sync_playwright

import camgen
from camgen.pipeline import Result
from camgen.preview.page import format_page
from camgen.preview.view import make_view

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
_SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
_WIDE, _NARROW = (1400, 880), (390, 844)
#: Number of shapes of the large drawing, and of shapes in a row.
_SHAPES, _ROW = 5000, 100


class Screen(Struct, frozen=True):
    """A picture of the page.

    make: function that builds the result on the page.
    size: width and height of the window, px.
    scheme: light or dark.
    then: script that runs before the picture is taken.
    """

    make: Callable[[], Result]
    size: tuple[int, int] = _WIDE
    scheme: str = "light"
    then: str = ""


def plate() -> Result:
    """A motor plate that three tools cut."""
    return camgen.build(
        PARTS / "motor.dxf",
        post="gcode",
        job=ROOT / "fixtures" / "cases" / "motor-plate" / "job.toml",
    )


def bracket() -> Result:
    """A drawing with contours that are too narrow for the tool."""
    return camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})


def block() -> Result:
    """The edges of a 3-D part, run by an arm."""
    return camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")


def photo() -> Result:
    """A part in a picture."""
    job = {"operation": {"kind": "follow"}, "image": {"mm_per_px": 0.1}}
    return camgen.build(PARTS / "gear.png", post="gcode", job=job)


def described() -> Result:
    """A drawing for an arm that a URDF describes."""
    cell = {
        "robot": str(PARTS.parent / "robots" / "six.urdf"),
        "base_from_work": [300, -60, -50, 0, 0, 0],
    }
    more = {"flange_from_tool": [0, 0, 100, 0, 0, 0], "home": [0, -100, 0, 0, 30, 0]}
    return camgen.build(PARTS / "bracket.dxf", post="rapid", job={"cell": cell | more})


def large() -> Result:
    """Thousands of circles and squares."""
    lines = ["0", "SECTION", "2", "ENTITIES"]
    for k in range(_SHAPES):
        x, y = k % _ROW * 12.0, k // _ROW * 12.0
        if k % 2:
            lines += ["0", "CIRCLE", "8", "HOLES", "10", f"{x}", "20", f"{y}", "40", "4"]
            continue
        lines += ["0", "POLYLINE", "8", "SQUARES", "66", "1", "70", "1"]
        for dx, dy in ((-4, -4), (4, -4), (4, 4), (-4, 4)):
            lines += ["0", "VERTEX", "8", "0", "10", f"{x + dx}", "20", f"{y + dy}"]
        lines += ["0", "SEQEND"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shapes.dxf"
        file.write_text("\n".join([*lines, "0", "ENDSEC", "0", "EOF\n"]))
        return camgen.build(file, post="gcode", job={"operation": {"kind": "trace"}})


_HALF = "camgen.player.to(camgen.track.time.at(-1) / 2)"
_TEXT = f"document.querySelector('[data-tab=text]').click(), {_HALF}"
_LAYERS = "document.querySelector('[data-do=layers]').click()"
SCREENS = {
    "light": Screen(plate, then=_TEXT),
    "dark": Screen(plate, scheme="dark", then=_TEXT),
    "notes": Screen(bracket, then="camgen.pointAt(0)"),
    "narrow": Screen(block, _NARROW, then=_HALF),
    "large": Screen(large, then=_HALF),
    "arm": Screen(block, then=f"{_HALF}, {_LAYERS}"),
    "arm-dark": Screen(block, scheme="dark", then="camgen.fit(false)"),
    "urdf": Screen(described, then=_HALF),
    "photo": Screen(photo, then=_HALF),
}


def shoot(browser: Browser, screen: Screen, folder: Path, target: Path) -> None:
    """Takes one picture."""
    file = folder / "page.html"
    file.write_text(format_page(make_view(screen.make())), encoding="utf-8")
    width, height = screen.size
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme="dark" if screen.scheme == "dark" else "light",
    )
    tab = context.new_page()
    tab.goto(file.as_uri())
    if screen.then:
        tab.evaluate(f"() => {{ {screen.then}; }}")
    # Shapes are coarse while they move and complete some frames later, a photo one frame later.
    tab.wait_for_timeout(1500)
    tab.screenshot(path=target)
    context.close()


def main(target: Path, names: list[str]) -> None:
    """Takes the pictures with these names, all of them without a name."""
    target.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as started, tempfile.TemporaryDirectory() as folder:
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=_SWITCHES)
        for name in names or SCREENS:
            shoot(browser, SCREENS[name], Path(folder), target / f"{name}.png")
            print(target / f"{name}.png", flush=True)
        browser.close()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2:])
