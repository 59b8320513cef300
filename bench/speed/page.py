"""The preview page of ordinary and large parts: size, seconds, frames per second.

    python -m bench.speed.page [SEGMENTS, 200000] [SECONDS, 4] [OPENINGS, 5]

The parts are a drawing, a picture, a 3-D part with an arm, and a drawing of SEGMENTS segments. Each
is opened OPENINGS times in a browser of its own. The start of the browser is not counted, but in
the first opening that of its process for pictures is. All turn and play for SECONDS each, after as
long a run-in. It needs playwright and a Chromium, or its shell without windows; it renders in
software.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

import camgen
from bench.support.runner import PARTS, open_table, read_words
from camgen.preview.page import format_page
from camgen.preview.view import make_view

COLUMNS = (
    "part | points of the program {:,} | page {:.1f} MB | in a new browser {:.2f} s "
    "| first picture, median {:.2f} s | whole, best {:.2f} s | frames/s turning {:.0f} "
    "| frames/s playing {:.0f}"
)
#: The first that is installed is measured.
BROWSERS = "chromium", "chromium-headless-shell"
SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
JOB = {"operation": {"kind": "trace"}}
#: The change before each frame, and the tab that is open then.
MOVES = {"turning": "paths", "playing": "text"}
#: Frames per second.
FRAMES = """async ([move, tab, seconds]) => {
  const total = camgen.track.time.at(-1);
  const moves = {
    turning: () => camgen.orbit(2, 0),
    playing: () => camgen.player.to((camgen.player.time + total / 997) % total),
  };
  document.querySelector(`[data-tab=${tab}]`).click();
  const run = async () => {
    const begin = performance.now();
    let frames = 0;
    while (performance.now() - begin < seconds * 1000) {
      moves[move]();
      frames++;
      await new Promise(requestAnimationFrame);
    }
    return (frames / (performance.now() - begin)) * 1000;
  };
  await run();
  return run();
}"""


def build_ordinary() -> list[camgen.Result]:
    """A drawing, a picture, and a 3-D part with an arm."""
    picture = {"operation": {"kind": "follow"}, "image": {"mm_per_px": 0.1}}
    return [
        camgen.build(PARTS / "bracket.dxf", post="gcode"),
        camgen.build(PARTS / "gear.png", post="gcode", job=picture),
        camgen.build(PARTS / "rfa1.stl", post="rapid"),
    ]


def build_rings(count: int, each: int = 500) -> camgen.Result:
    """Closed wavy rings of ``each`` lines, ``count`` lines in all."""
    turn = np.linspace(0, 2 * np.pi, each, endpoint=False)
    radius = 20 + 3 * np.sin(7 * turn) + np.random.default_rng(1).normal(0, 0.1, each)
    lines = ["0", "SECTION", "2", "ENTITIES"]
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) * radius[:, None]
    for k in range(count // each):
        lines += ["0", "POLYLINE", "8", f"L{k % 7}", "66", "1", "70", "1"]
        for x, y in ring + np.array([k % 20, k // 20]) * 60:
            lines += ["0", "VERTEX", "8", "0", "10", f"{x:.4f}", "20", f"{y:.4f}"]
        lines += ["0", "SEQEND"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rings.dxf"
        file.write_text("\n".join([*lines, "0", "ENDSEC", "0", "EOF\n"]))
        return camgen.build(file, post="gcode", job=JOB)


#: Paints and waits until that is done: the pixel is read then.
PAINT = "camgen.paint({}), camgen.gl.readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4))"


def open_page(browser: Browser, file: Path) -> tuple[Page, float, float]:
    """The page, and two times from the request, s.

    They end with the first picture, drawn again as it was, and with the picture with all details.
    """
    tab = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    start = time.perf_counter()
    tab.goto(file.as_uri())
    tab.evaluate(PAINT.format("camgen.pace.drawn"))
    first = time.perf_counter() - start
    tab.evaluate(PAINT.format(0))
    return tab, first, time.perf_counter() - start


def measure(
    browser: Browser, result: camgen.Result, folder: Path, turning: float, openings: int
) -> tuple[object, ...]:
    """The cells of a part."""
    view = make_view(result)
    text = format_page(view)
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    opened = []
    for k in range(openings):
        tab, *times = open_page(browser, file)
        opened.append(times)
        if k + 1 == openings:
            rates = [tab.evaluate(FRAMES, [*move, turning]) for move in MOVES.items()]
        tab.context.close()
    head = result.part.source, len(view.track.time), len(text.encode()) / 1e6
    # The first opening has a column of its own.
    first, whole = zip(*(opened[1:] or opened), strict=True)
    return *head, opened[0][0], statistics.median(first), min(whole), *rates


def main(segments: int, turning: float, openings: int) -> None:
    results = [*build_ordinary(), build_rings(segments)]
    table = open_table(COLUMNS)
    with sync_playwright() as started, tempfile.TemporaryDirectory() as pages:
        browser = None
        for result in results:
            # One opening each: a browser for all, the first part starts it.
            if browser is None or openings > 1:
                program = next(filter(None, map(shutil.which, BROWSERS)))
                browser = started.chromium.launch(executable_path=program, args=SWITCHES)
            table.add(*measure(browser, result, Path(pages), turning, openings))
            if openings > 1:
                browser.close()


if __name__ == "__main__":
    main(*read_words(200_000, 4.0, 5))
