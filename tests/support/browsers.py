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

#: A browser of the system, else the one that playwright brought.
SYSTEM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
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
        switches = [
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--ignore-gpu-blocklist",
            "--no-sandbox",
        ]
        opened = started.chromium.launch(executable_path=SYSTEM, args=switches, timeout=1000 * LONG)
        yield opened
        opened.close()


class Opened:
    """A page with everything that it said or asked for."""

    def __init__(self, browser: Driven, file: Path, size: dict[str, int], scheme: str) -> None:
        self.said: list[str] = []
        self.asked: list[str] = []
        self.context = browser.new_context(
            viewport=size, color_scheme=scheme, has_touch=size is PHONE
        )
        self.context.set_default_timeout(1000 * LONG)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
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
