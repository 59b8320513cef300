"""Pages in a real browser without a window."""

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.waiting import LONG

#: Browsers of a system, the fastest first: a shell without windows takes half of the time of a whole browser.
NAMES = "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"
#: The browser of this system, else the one that playwright brought.
SYSTEM = next(filter(None, map(shutil.which, NAMES)), None)
#: What the rasteriser says each time a page reads a pixel. It is true and no fault of the page.
SLOW_READ = "GPU stall due to ReadPixels"
#: Of a desk, of a phone, and of a small desk: the processor draws the pages, in a time that grows with them.
SIZE, PHONE, SMALL = (
    {"width": 1280, "height": 800},
    {"width": 390, "height": 844},
    {"width": 960, "height": 600},
)
Driven = Any


@contextmanager
def start_browser() -> Iterator[Driven]:
    """A Chromium that draws with the processor; the test is skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as started:
        if not SYSTEM and not os.path.exists(started.chromium.executable_path):
            pytest.skip("no Chromium is installed")
        # Only the scenes are drawn by the rasteriser in software, not the rest of a page.
        switches = ["--enable-unsafe-swiftshader", "--no-sandbox"]
        opened = started.chromium.launch(executable_path=SYSTEM, args=switches, timeout=1000 * LONG)
        yield opened
        opened.close()


class Heard:
    """What a page said, and the addresses that it asked for."""

    def __init__(self, page: Driven) -> None:
        self.said: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda message: self._say(message.text))
        page.on("pageerror", lambda error: self._say(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))

    def _say(self, text: str) -> None:
        if SLOW_READ not in text:
            self.said.append(text)


class Opened:
    """A page with everything that it said or asked for."""

    def __init__(self, browser: Driven, file: Path, size: dict[str, int], scheme: str) -> None:
        self.context = browser.new_context(
            viewport=size, color_scheme=scheme, has_touch=size is PHONE
        )
        self.context.set_default_timeout(1000 * LONG)
        self.page = self.context.new_page()
        heard = Heard(self.page)
        self.said, self.asked = heard.said, heard.asked
        self.page.goto(file.as_uri())
        self.page.wait_for_function("() => window.camgen !== undefined")

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)

    def picture(self) -> np.ndarray[Any, Any]:
        """What the scene shows, (H, W, 3)."""
        # Two frames later what was asked for is drawn.
        self.run(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        raw = self.page.locator("#canvas").screenshot()
        return cv2.imdecode(np.frombuffer(io.BytesIO(raw).getvalue(), np.uint8), cv2.IMREAD_COLOR)
