"""The preview page of ordinary parts, of the largest drawing and of one made by hand: size, seconds, frames per second.

    python -m bench.speed.page [FOLDER] [SEGMENTS, 200000] [SECONDS, 4] [OPENINGS, 5]

FOLDER holds drawings (default: ``shared/data/dxf`` beside the repository). The largest is the one whose program has the
most points on the screen. The other one has SEGMENTS segments. The ordinary ones are a drawing, a picture, and a 3-D
part with an arm. Each is opened OPENINGS times in a browser of its own, which is there already: the start of a browser
is not counted, but in the first opening that of its process for pictures is. All turn, play and scroll through the
program's text for SECONDS each, after as long a run-in. Needs playwright and a Chromium, or its shell without windows;
it renders in software.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright

import camgen
from bench.support.runner import PARTS, SHARED, open_table, read_words
from bench.support.timing import timed
from camgen.preview.page import format_page
from camgen.preview.view import make_view

COLUMNS = (
    "part | points of the program {:,} | page {:.1f} MB | made in {:.2f} s "
    "| in a new browser {:.2f} s | first picture, best {:.2f} s | median {:.2f} s "
    "| whole, best {:.2f} s | processor, best {:.2f} s | frames/s turning {:.0f} "
    "| frames/s playing {:.0f} | frames/s scrolling {:.0f} | script per frame {:.1f} ms"
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
#: What is done before each frame, and the tab that is open then.
MOVES = {"turning": "paths", "playing": "text", "scrolling": "text"}
#: Frames per second. Scrolling: thousands of lines at a time.
FRAMES = """async ([move, tab, seconds]) => {
  const code = document.getElementById("code");
  const total = camgen.track.time.at(-1);
  const moves = {
    turning: () => camgen.orbit(2, 0),
    playing: () => camgen.player.to((camgen.player.time + total / 997) % total),
    scrolling: () => { code.scrollTop = (code.scrollTop + 70001) % Math.max(code.scrollHeight, 1); },
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

#: What the page itself takes for a frame, without the drawing of it.
SCRIPT = """() => {
  const begin = performance.now();
  for (let k = 0; k < 10; k++) { camgen.orbit(1, 0); camgen.paint(); }
  return (performance.now() - begin) / 10;
}"""


def ordinary() -> list[camgen.Result]:
    """A drawing, a picture, and a 3-D part with an arm."""
    picture = {"operation": {"kind": "follow"}, "image": {"mm_per_px": 0.1}}
    return [
        camgen.build(PARTS / "bracket.dxf", post="gcode"),
        camgen.build(PARTS / "gear.png", post="gcode", job=picture),
        camgen.build(PARTS / "rfa1.stl", post="rapid"),
    ]


def largest(folder: Path) -> camgen.Result:
    found = None
    for path in sorted(folder.rglob("*.dxf")):
        try:
            result = camgen.build(path, post="gcode", job=JOB)
        except camgen.CamgenError:
            continue
        if found is None or len(make_view(result).track.time) > len(make_view(found).track.time):
            found = result
    if found is None:
        sys.exit(f"{folder}: no drawing that can be traced")
    return found


def by_hand(count: int, each: int = 500) -> camgen.Result:
    """Closed wavy rings of ``each`` lines, ``count`` lines in all."""
    turn = np.linspace(0, 2 * np.pi, each, endpoint=False)
    radius = 20 + 3 * np.sin(7 * turn) + np.random.default_rng(1).normal(0, 0.1, each)
    lines = ["0", "SECTION", "2", "ENTITIES"]
    for k in range(count // each):
        lines += ["0", "POLYLINE", "8", f"L{k % 7}", "66", "1", "70", "1"]
        for x, y in zip(
            radius * np.cos(turn) + k % 20 * 60, radius * np.sin(turn) + k // 20 * 60, strict=True
        ):
            lines += ["0", "VERTEX", "8", "0", "10", f"{x:.4f}", "20", f"{y:.4f}"]
        lines += ["0", "SEQEND"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rings.dxf"
        file.write_text("\n".join([*lines, "0", "ENDSEC", "0", "EOF\n"]))
        return camgen.build(file, post="gcode", job=JOB)


def processor(session: CDPSession) -> dict[int, float]:
    """Seconds that the processes of pages and of pictures have taken, by their ids."""
    found = session.send("SystemInfo.getProcessInfo")["processInfo"]
    return {one["id"]: one["cpuTime"] for one in found if one["type"] in ("renderer", "GPU")}


#: Paints and waits until it is done: the pixel is read then.
PAINT = "camgen.paint({}), camgen.gl.readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4))"


def opening(browser: Browser, file: Path) -> tuple[Page, float, float, float]:
    """The page; seconds from asking for it to its first picture, drawn again as it was, those of the processor in
    between, and seconds to the picture with all borders and details.
    """
    session = browser.new_browser_cdp_session()
    tab = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    before, begin = processor(session), time.perf_counter()
    tab.goto(file.as_uri())
    tab.evaluate(PAINT.format("camgen.pace.drawn"))
    passed = time.perf_counter() - begin
    taken = sum(seconds - before.get(number, 0.0) for number, seconds in processor(session).items())
    session.detach()
    tab.evaluate(PAINT.format(0))
    return tab, passed, taken, time.perf_counter() - begin


def measured(
    browser: Browser, result: camgen.Result, folder: Path, turning: float, openings: int
) -> tuple[object, ...]:
    """The cells of a part."""
    text, made = timed(lambda: format_page(make_view(result)))
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    found = []
    for k in range(openings):
        tab, *times = opening(browser, file)
        found.append(times)
        if k + 1 == openings:
            rates = [tab.evaluate(FRAMES, [*move, turning]) for move in MOVES.items()]
            script = tab.evaluate(SCRIPT)
        tab.context.close()
    points = len(make_view(result).track.time)
    size = len(text.encode()) / 1e6
    # The first opening stands by itself.
    passed, taken, whole = zip(*(found[1:] or found), strict=True)
    seconds = min(passed), statistics.median(passed), min(whole), min(taken)
    return result.part.source, points, size, made, found[0][0], *seconds, *rates, script


def main(folder: Path, segments: int, turning: float, openings: int) -> None:
    results = [*ordinary(), largest(folder), by_hand(segments)]
    table = open_table(COLUMNS)
    with sync_playwright() as started, tempfile.TemporaryDirectory() as pages:
        browser = None
        for result in results:
            # One opening each: a browser for all, the first part starts it.
            if browser is None or openings > 1:
                browser = started.chromium.launch(
                    executable_path=next(filter(None, map(shutil.which, BROWSERS))), args=SWITCHES
                )
            table.add(*measured(browser, result, Path(pages), turning, openings))
            if openings > 1:
                browser.close()


if __name__ == "__main__":
    main(*read_words(SHARED / "dxf", 200_000, 4.0, 5))
