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

#: Names of installed browsers, the fastest first. A shell without windows takes half of the
#: processor time of a whole browser.
NAMES = "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"
#: The browser of this system; without one, the browser that playwright installed is used.
SYSTEM = next(filter(None, map(shutil.which, NAMES)), None)
#: A message of the rasteriser for each pixel that a page reads. It reports no fault of the page.
SLOW_READ = "GPU stall due to ReadPixels"
#: Windows of a desk, a phone and a small desk. The time to draw a page grows with its window.
SIZE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
SMALL = {"width": 960, "height": 600}
#: Runs before the scripts of a page, in frames too, so that the page works as in a browser without
#: WebGL. To draw the scene takes half of the processor time of a page.
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
Driven = Any


@contextmanager
def start_browser() -> Iterator[Driven]:
    """A Chromium that draws with the processor; the test is skipped without one."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as started:
        if not SYSTEM and not os.path.exists(started.chromium.executable_path):
            pytest.skip("no Chromium is installed")
        # The rasteriser in software draws only the scenes, not the rest of a page.
        switches = ["--enable-unsafe-swiftshader", "--no-sandbox"]
        opened = started.chromium.launch(executable_path=SYSTEM, args=switches, timeout=1000 * LONG)
        yield opened
        opened.close()


def open_context(browser: Driven, draws: bool, **options: Any) -> Driven:
    """A context of the browser.

    draws: whether its pages have WebGL and draw the scene
    options: options of Playwright
    """
    context = browser.new_context(**options)
    context.set_default_timeout(1000 * LONG)
    if not draws:
        context.add_init_script(NO_WEBGL)
    return context


class PageLog:
    """Messages and requests of a page.

    messages: texts of the console and of errors.
    requests: addresses that the page asks for.
    """

    def __init__(self, page: Driven) -> None:
        self.messages: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda message: self._add(message.text))
        page.on("pageerror", lambda error: self._add(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))

    def _add(self, text: str) -> None:
        if SLOW_READ not in text:
            self.messages.append(text)


class OpenPage:
    """A file that is open in a browser.

    draws: whether the page draws its scene
    """

    def __init__(
        self,
        browser: Driven,
        file: Path,
        size: dict[str, int] = SMALL,
        scheme: str = "light",
        draws: bool = True,
    ) -> None:
        self.context = open_context(
            browser, draws, viewport=size, color_scheme=scheme, has_touch=size is PHONE
        )
        self.page = self.context.new_page()
        self.log = PageLog(self.page)
        self.page.goto(file.as_uri())
        self.page.wait_for_function("() => window.camgen !== undefined")

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)

    def picture(self) -> np.ndarray[Any, Any]:
        """The scene as a picture, (H, W, 3)."""
        # After two frames the scene is drawn.
        self.run(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        raw = self.page.locator("#canvas").screenshot()
        return cv2.imdecode(np.frombuffer(io.BytesIO(raw).getvalue(), np.uint8), cv2.IMREAD_COLOR)
