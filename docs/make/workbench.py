"""Pictures of the workbench, from a real browser without a window.

    python -m docs.make.workbench [FOLDER]

writes them into FOLDER to be looked at; without one only the picture of docs/workbench.md into docs/images. It needs
the extra ``workbench``, playwright and a Chromium.
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

from docs.make.pictures import coarse

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
_SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
#: Nothing is being built, and there is a program or a reason why there is none.
_RESTS = (
    "() => { const s = window.workbench?.state(); return s && !s.stage && (s.built || s.failed); }"
)


class Shown(Struct, frozen=True):
    """One picture. words: of the command. tab: of the form that is open. clicks: on elements, in this order."""

    name: str
    file: str
    words: tuple[str, ...] = ()
    size: tuple[int, int] = (1400, 850)
    scheme: str = "light"
    tab: str = "settings"
    clicks: tuple[str, ...] = ()


_JOB = ("--job", str(ROOT / "fixtures" / "cases" / "motor-plate" / "job.toml"))
PICTURES = (
    Shown("workbench.png", "motor.dxf", _JOB, tab="steps"),
    Shown("settings.png", "bracket.dxf", ("--set", "process.feed=30", "--set", "tool.diameter=4")),
    Shown("dark.png", "bracket.dxf", scheme="dark"),
    Shown("narrow.png", "bracket.dxf", size=(390, 844)),
    Shown("layers.png", "layers.dxf", tab="layers"),
    Shown("error.png", "bracket.dxf", ("--job", "bad.toml"), clicks=("#says button",)),
    Shown("proposed.png", "motor.dxf", tab="steps", clicks=("text=Propose operations",)),
    Shown("solid.png", "rfa1.stl", tab="layers"),
    Shown(
        "photo.png",
        "gear.png",
        ("--set", "image.mm_per_px=0.2"),
        clicks=("text=From picture to path",),
    ),
    Shown("unscaled.png", "photo.png"),
    Shown("large.png", "large.dxf", ("--set", "operation.kind=trace"), tab="summary"),
)


@contextmanager
def opened(folder: Path, shown: Shown) -> Iterator[str]:
    """The address of a workbench for a picture."""
    command = [sys.executable, "-m", "camgen", "open", shown.file, *shown.words, "--no-browser"]
    # Journals of these workbenches do not lie in the folder of the user.
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
    with subprocess.Popen(
        command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stderr is not None
        try:
            yield process.stderr.readline().split()[1]
        finally:
            process.terminate()


def shoot(browser: Browser, address: str, shown: Shown, target: Path) -> None:
    wide, high = shown.size
    scheme: Any = shown.scheme
    page = browser.new_page(viewport={"width": wide, "height": high}, color_scheme=scheme)
    page.goto(address)
    settle(page)
    page.locator(f"[data-tab={shown.tab}]").click()
    for click in shown.clicks:
        page.locator(click).first.click()
        page.wait_for_timeout(300)
        settle(page)
    page.screenshot(path=target)
    page.close()


def settle(page: Page) -> None:
    """Until what was asked for is built and seen."""
    page.wait_for_function(_RESTS, timeout=120_000)
    page.wait_for_function(
        "() => !workbench.state().built || document.querySelector('#frames iframe:not(.coming)')"
    )
    page.wait_for_timeout(2500)


def lay_out(folder: Path) -> None:
    """The inputs, and two that are made: 5,000 shapes, and a photo that nobody gave a scale."""
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
    chromium = shutil.which("chromium")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as started:
        lay_out(Path(name))
        browser = started.chromium.launch(executable_path=chromium, args=_SWITCHES)
        for shown in PICTURES if target else PICTURES[:1]:
            file = (target or Path(name)) / shown.name
            with opened(Path(name), shown) as address:
                shoot(browser, address, shown, file)
            if target is None:
                pixels = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
                small = cv2.resize(pixels, (1050, 638), interpolation=cv2.INTER_AREA)
                file = ROOT / "docs" / "images" / shown.name
                file.write_bytes(coarse(small, 12))
            print(f"{shown.name}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
