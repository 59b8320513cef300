"""Pictures of the workbench, from a real browser without a window.

    python -m docs.make.workbench [FOLDER]

writes all pictures into FOLDER. Without FOLDER it writes the picture of docs/workbench.md into
docs/images. The extra `workbench`, playwright and a Chromium are needed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import ezdxf
import numpy as np
from msgspec import Struct
from playwright.sync_api import Browser, Page, sync_playwright

from docs.make.pictures import reduce_shades

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
_SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
#: No build runs, and there is a program or an error.
_HAS_ENDED = (
    "() => { const s = window.workbench?.state(); return s && !s.stage && (s.built || s.failed); }"
)


class WorkbenchPicture(Struct, frozen=True):
    """A picture of the workbench.

    name: name of the picture.
    file: input of `camgen open`.
    words: further words of the command.
    size: width and height of the window, px.
    scheme: light or dark.
    tab: pane of the form that is open.
    clicks: selectors of elements that are clicked, in order.
    """

    name: str
    file: str
    words: tuple[str, ...] = ()
    size: tuple[int, int] = (1400, 850)
    scheme: str = "light"
    tab: str = "settings"
    clicks: tuple[str, ...] = ()


_JOB = ("--job", str(ROOT / "fixtures" / "cases" / "motor-plate" / "job.toml"))
PICTURES = (
    WorkbenchPicture("workbench.png", "motor.dxf", _JOB, tab="steps"),
    WorkbenchPicture(
        "settings.png", "bracket.dxf", ("--set", "process.feed=30", "--set", "tool.diameter=4")
    ),
    WorkbenchPicture("dark.png", "bracket.dxf", scheme="dark"),
    WorkbenchPicture("narrow.png", "bracket.dxf", size=(390, 844)),
    WorkbenchPicture("layers.png", "layers.dxf", tab="layers"),
    WorkbenchPicture("error.png", "bracket.dxf", ("--job", "bad.toml"), clicks=("#says button",)),
    WorkbenchPicture("proposed.png", "motor.dxf", tab="steps", clicks=("text=Propose operations",)),
    WorkbenchPicture("solid.png", "rfa1.stl", tab="layers"),
    WorkbenchPicture(
        "photo.png",
        "gear.png",
        ("--set", "image.mm_per_px=0.2"),
        clicks=("text=From picture to path",),
    ),
    WorkbenchPicture("unscaled.png", "photo.png"),
    WorkbenchPicture("large.png", "large.dxf", ("--set", "operation.kind=trace"), tab="summary"),
)


@contextmanager
def open_workbench(folder: Path, picture: WorkbenchPicture) -> Iterator[str]:
    """The address of a workbench for a picture."""
    command = [sys.executable, "-m", "camgen", "open", picture.file, *picture.words, "--no-browser"]
    # The journals of these workbenches must not be in the folder of the user.
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
    with subprocess.Popen(
        command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stderr is not None
        try:
            yield process.stderr.readline().split()[1]
        finally:
            process.terminate()


def shoot(browser: Browser, address: str, picture: WorkbenchPicture, target: Path) -> None:
    width, height = picture.size
    scheme: Any = picture.scheme
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
    page.goto(address)
    wait_for_page(page)
    page.locator(f"[data-tab={picture.tab}]").click()
    for click in picture.clicks:
        page.locator(click).first.click()
        page.wait_for_timeout(300)
        wait_for_page(page)
    page.screenshot(path=target)
    page.close()


def wait_for_page(page: Page) -> None:
    """Waits until the build has ended and the page shows it."""
    page.wait_for_function(_HAS_ENDED, timeout=120_000)
    page.wait_for_function(
        "() => !workbench.state().built || document.querySelector('#frames iframe:not(.coming)')"
    )
    page.wait_for_timeout(2500)


def write_inputs(folder: Path) -> None:
    """Writes the inputs: fixtures, a drawing of 5,000 circles, and a photo without a scale."""
    for name in (
        "motor.dxf",
        "bracket.dxf",
        "layers.dxf",
        "rfa1.stl",
        "rfa1.toml",
        "rfa1_base.stl",
        "gear.png",
    ):
        shutil.copy(PARTS / name, folder / name)
    (folder / "bad.toml").write_text("[operation]\nlead_in = -5\n")
    drawing = ezdxf.new("R2010", units=4)
    for k in range(5000):
        drawing.modelspace().add_circle(
            (6.0 * (k % 100), 6.0 * (k // 100)), 1.0 + 1.5 * (k % 7) / 7
        )
    drawing.saveas(folder / "large.dxf")
    bench = np.full((600, 900, 3), 40, np.uint8)
    photo = cv2.rectangle(bench, (200, 150), (700, 450), (210, 215, 220), -1)
    cv2.imwrite(str(folder / "photo.png"), cv2.circle(photo, (450, 300), 80, (40, 40, 40), -1))


def main(target: Path | None) -> None:
    """Takes all pictures into a folder, or the picture of the page if there is no folder."""
    chromium = shutil.which("chromium")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as started:
        write_inputs(Path(name))
        browser = started.chromium.launch(executable_path=chromium, args=_SWITCHES)
        for picture in PICTURES if target else PICTURES[:1]:
            file = (target or Path(name)) / picture.name
            with open_workbench(Path(name), picture) as address:
                shoot(browser, address, picture, file)
            if target is None:
                pixels = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
                resized = cv2.resize(pixels, (1050, 638), interpolation=cv2.INTER_AREA)
                file = ROOT / "docs" / "images" / picture.name
                file.write_bytes(reduce_shades(resized, 12))
            print(f"{picture.name}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
