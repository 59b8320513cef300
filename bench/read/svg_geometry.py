"""Compares the contours of SVG drawings with the geometry that a browser draws.

    python -m bench.read.svg_geometry [DRAWINGS, 100] [FIRST SEED, 1] [svgelements | svgpathtools]

The drawings are those of the grammar `bench.read.svg_files`, one per seed. A headless Chromium
draws each, and 200 points along every shape (`getPointAtLength`) are carried to the page by
`getScreenCTM`. A shape is drawn if it is rendered, visible and painted, at the beginning of all
animations; its points count if no `clip-path` and no viewport of a nested svg hides them. Copies
that `use` makes are measured after their `use` is replaced by the elements that it stands for; the
box that the browser draws them in has to stay the same within 0.01 px.

camgen reads the same file with a chord tolerance of 0.001 mm. Each shape has a color or a layer
of its own, by which it is compared. A shape differs if a point that the browser draws is more
than 0.01 mm away from the contours, or if a contour is farther than 0.01 mm and one step between
the points away from all points that the browser draws: it has another place or size, is missing,
or is drawn too much. A part of a clipped shape that is shorter than two steps may have no point of
the browser, so it is not counted as too much. A difference is silent if no note, and no refusal for
lack of contours, has the layer or the id of the shape in it. A drawing that is refused, or fails,
for another reason is counted as such, and all its shapes as silent. Fails if a difference is silent
or a drawing fails.

With the name of another library, its shapes are compared in place of camgen's. It has no notes,
so that each difference is silent. It has to be installed.
"""

from __future__ import annotations

import importlib
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.read.svg_files import Drawing, draw
from bench.support.motions import measure_from_lines
from bench.support.runner import Missed, Table, open_table, read_words
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import CamgenError
from camgen.read import read
from camgen.read.job_file import from_mapping
from tests.support.browsers import start_browser

FloatArray = NDArray[np.float64]
MM_PER_PX = 25.4 / 96
#: mm between a point of the browser and the contours that is not a difference.
TOLERANCE_MM = 0.01
#: px by which the box of a `use` may change if it is replaced.
SAME_BOX_PX = 0.01
#: Points along each shape.
SAMPLES = 200
#: Settings of camgen: curves much closer than the tolerance, and no ends of two shapes joined.
JOB = {"tolerance": {"chord": 0.001}, "input": {"join": 1e-6}}

#: Replaces each `use` by the elements that it stands for (SVG 2, section 5.5). Gives the largest
#: change of their boxes, px.
EXPAND = r"""
() => {
  const svg = 'http://www.w3.org/2000/svg', xlink = 'http://www.w3.org/1999/xlink';
  const never = 'defs,symbol,clipPath,mask,marker,pattern';
  const place = (use, name) => {
    const text = getComputedStyle(use)[name];
    return text.endsWith('px') ? parseFloat(text) : use[name].baseVal.value;
  };
  let largest = 0;
  const measure = (element) => {
    const {x, y, width, height} = element.getBoundingClientRect();
    return [x, y, width, height];
  };
  for (const use of [...document.querySelectorAll('use')]) {
    if (use.closest(never)) continue;
    const href = use.getAttribute('href') ?? use.getAttributeNS(xlink, 'href');
    const target = document.getElementById(href.slice(1));
    if (!target) continue;
    const outer = document.createElementNS(svg, 'g'), inner = document.createElementNS(svg, 'g');
    for (const {name, value} of use.attributes)
      if (!['x', 'y', 'width', 'height', 'href', 'xlink:href'].includes(name))
        outer.setAttribute(name, value);
    inner.setAttribute('transform', `translate(${place(use, 'x')} ${place(use, 'y')})`);
    let copy = target.cloneNode(true);
    if (target.tagName === 'symbol') {
      copy = document.createElementNS(svg, 'svg');
      for (const {name, value} of target.attributes) copy.setAttribute(name, value);
      for (const child of target.childNodes) copy.append(child.cloneNode(true));
    }
    if (copy.tagName === 'svg')
      for (const name of ['width', 'height'])
        if (use.hasAttribute(name)) copy.setAttribute(name, use.getAttribute(name));
    inner.append(copy);
    outer.append(inner);
    const before = measure(use);
    use.replaceWith(outer);
    measure(outer).forEach((value, k) => {
      largest = Math.max(largest, Math.abs(value - before[k]));
    });
  }
  return largest;
}
"""
#: Points of all shapes in px of the page, and which of them are drawn.
MEASURE = r"""
(samples) => {
  const root = document.documentElement;
  const never = 'defs,symbol,clipPath,mask,marker,pattern';
  const isPainted = (paint, opacity) => {
    if (paint === 'none' || parseFloat(opacity) === 0) return false;
    const link = /^url\("#(.*)"\)\s*(.*)/.exec(paint);
    if (link) return Boolean(document.getElementById(link[1])) || !['', 'none'].includes(link[2]);
    return !/^rgba\(.*, 0\)$/.test(paint);
  };
  const isDrawn = (shape) => {
    if (shape.closest(never)) return false;
    if (!shape.checkVisibility({opacityProperty: true, visibilityProperty: true})) return false;
    const style = getComputedStyle(shape);
    const stroke = isPainted(style.stroke, style.strokeOpacity);
    return isPainted(style.fill, style.fillOpacity)
      || (stroke && parseFloat(style.strokeWidth) !== 0);
  };
  const isInside = (clip, user, point) => {
    if (!clip) return true;
    let local = point.matrixTransform(user.getScreenCTM().inverse());
    if (clip.getAttribute('clipPathUnits') === 'objectBoundingBox') {
      const box = user.getBBox();
      local = new DOMPoint((local.x - box.x) / box.width, (local.y - box.y) / box.height);
    }
    return [...clip.children].some((child) => {
      const moved = child.transform.baseVal.consolidate();
      const there = moved ? local.matrixTransform(moved.matrix.inverse()) : local;
      return child.isPointInFill(there);
    });
  };
  const findClips = (shape) => {
    const tests = [];
    for (let user = shape; user !== root; user = user.parentElement) {
      const style = getComputedStyle(user);
      const link = /^url\("#(.*)"\)/.exec(style.clipPath);
      if (link) {
        const clip = document.getElementById(link[1]), element = user;
        tests.push((point) => isInside(clip, element, point));
      }
      if (user.tagName === 'svg' && ['hidden', 'clip', 'scroll'].includes(style.overflow)) {
        const box = user.getAttribute('viewBox');
        user.removeAttribute('viewBox');
        const inverse = user.getScreenCTM().inverse();
        if (box !== null) user.setAttribute('viewBox', box);
        const width = user.width.baseVal.value, height = user.height.baseVal.value;
        tests.push((point) => {
          const {x, y} = point.matrixTransform(inverse);
          return x >= 0 && y >= 0 && x <= width && y <= height;
        });
      }
    }
    return tests;
  };
  return [...document.querySelectorAll('[data-shape]')].map((shape) => {
    const result = {shape: Number(shape.dataset.shape), points: [], step: 0};
    if (!isDrawn(shape)) return result;
    const length = shape.getTotalLength();
    if (length === 0) return result;
    const matrix = shape.getScreenCTM(), clips = findClips(shape);
    const {a, b, c, d} = matrix;
    result.step = length / samples * Math.hypot(a, b, c, d);
    for (let k = 0; k <= samples; k += 1) {
      const {x, y} = shape.getPointAtLength(length * k / samples);
      const point = new DOMPoint(x, y).matrixTransform(matrix);
      if (clips.every((test) => test(point))) result.points.push([point.x, point.y]);
    }
    return result;
  });
}
"""
#: Height of the page in px.
HEIGHT = "() => parseFloat(getComputedStyle(document.documentElement).height)"
PAUSE = """() => {
  document.documentElement.pauseAnimations();
  document.documentElement.setCurrentTime(0);
}"""


class Shape(NamedTuple):
    """A shape as the browser draws it.

    points: (N, 2), mm, y up from the lower edge of the page.
    step_mm: largest distance of neighbouring points along the shape.
    """

    points: FloatArray
    step_mm: float


class Reading(NamedTuple):
    """A drawing as a reader gives it.

    curves: points (N, 2) along each contour, mm, with the name of its layer.
    notes: all that it reports.
    fault: why it gives nothing, empty if it does.
    """

    curves: list[tuple[str, FloatArray]]
    notes: str
    fault: str


Reader = Callable[[Path, float], Reading]


def measure(page: Any, file: Path, drawing: Drawing) -> tuple[list[Shape], float]:
    """The shapes that the browser draws, and the height of the page in px.

    Raises ValueError if a box changes when each `use` is replaced.
    """
    page.set_viewport_size({"width": drawing.window[0], "height": drawing.window[1]})
    page.goto(file.as_uri())
    page.evaluate(PAUSE)
    change = page.evaluate(EXPAND)
    if change > SAME_BOX_PX:
        raise ValueError(f"{file.name}: a box changes by {change} px where a use is replaced")
    height = page.evaluate(HEIGHT)
    parts: list[list[Any]] = [[] for _ in drawing.layers]
    steps = [0.0] * len(drawing.layers)
    for measured in page.evaluate(MEASURE, SAMPLES):
        shape = measured["shape"]
        parts[shape] += measured["points"]
        steps[shape] = max(steps[shape], measured["step"] * MM_PER_PX)
    shapes = []
    for points, step in zip(parts, steps, strict=True):
        pixels = np.array(points, dtype=float).reshape(-1, 2)
        upwards = np.array([1.0, -1.0]) * (pixels - [0.0, height])
        shapes.append(Shape(upwards * MM_PER_PX, step))
    return shapes, height


def read_with_camgen(file: Path, height: float) -> Reading:  # noqa: ARG001 (a reader of a table)
    """The contours of camgen."""
    try:
        part = read(file, from_mapping(JOB))
    except CamgenError as error:
        is_empty = "nothing to machine" in str(error)
        return Reading([], str(error), "" if is_empty else f"refused: {error}")
    except Exception as error:
        return Reading([], "", f"fault: {error!r}")
    curves = []
    for contour in part.contours:
        points, _ = flatten(make_contour_segments([contour]), 1e-4)
        end = contour.points[:1] if contour.closed else contour.points[-1:]
        curves.append((contour.layer, np.concatenate([points, end])))
    return Reading(curves, "\n".join(map(str, part.notes)), "")


def read_with_svgelements(file: Path, height: float) -> Reading:
    """The shapes of svgelements."""
    library = importlib.import_module("svgelements")
    curves = []
    try:
        shapes = list(library.SVG.parse(str(file), ppi=96).elements())
        for shape in shapes:
            if not isinstance(shape, library.Shape):
                continue
            if shape.values.get("visibility") == "hidden":
                continue
            color = shape.stroke if shape.stroke.value is not None else shape.fill
            for subpath in library.Path(shape).as_subpaths():
                path = library.Path(subpath)
                fractions = np.linspace(0, 1, 4 * SAMPLES)
                pixels = np.asarray(path.npoint(fractions), dtype=float).reshape(-1, 2)
                points = np.array([1.0, -1.0]) * (pixels - [0.0, height]) * MM_PER_PX
                curves.append((str(color.hexrgb or color.hex), points))
    except Exception as error:
        return Reading([], "", f"fault: {error!r}")
    return Reading(curves, "", "")


def read_with_svgpathtools(file: Path, height: float) -> Reading:
    """The paths of svgpathtools, by its Document, which follows transforms of groups."""
    library = importlib.import_module("svgpathtools")
    curves = []
    try:
        for path in library.Document(str(file)).paths():
            words = path.element.attrib
            style = dict(re.findall(r"([\w-]+):([^;]*)", words.get("style", "")))
            stroke = style.get("stroke", words.get("stroke", "none"))
            color = words.get("fill", "") if stroke == "none" else stroke
            for subpath in path.continuous_subpaths():
                fractions = np.linspace(0, 1, 2 * SAMPLES)
                numbers = np.array([subpath.point(fraction) for fraction in fractions])
                points = np.column_stack([numbers.real, height - numbers.imag]) * MM_PER_PX
                curves.append((color, points))
    except Exception as error:
        return Reading([], "", f"fault: {error!r}")
    return Reading(curves, "", "")


READERS: dict[str, Reader] = {
    "camgen": read_with_camgen,
    "svgelements": read_with_svgelements,
    "svgpathtools": read_with_svgpathtools,
}


def distances(points: FloatArray, curves: Sequence[FloatArray]) -> FloatArray:
    """Distance of each point (N, 2) from the nearest polyline, mm; inf without a polyline."""
    nearest = np.full(len(points), np.inf)
    for curve in curves:
        gaps = measure_from_lines(points[:, None], curve[None, :-1], curve[None, 1:])
        nearest = np.minimum(nearest, gaps.min(axis=1))
    return nearest


def describe_difference(shape: Shape, curves: Sequence[FloatArray]) -> str:
    """How the curves differ from a shape of the browser; empty if they do not."""
    long_curves = [
        curve for curve in curves if np.hypot(*np.diff(curve, axis=0).T).sum() >= 2 * shape.step_mm
    ]
    if not len(shape.points):
        return "drawn too much" if long_curves else ""
    if not curves:
        return "missing"
    if (distances(shape.points, curves) > TOLERANCE_MM).any():
        return "another place or size"
    limit = TOLERANCE_MM + shape.step_mm
    for curve in long_curves:
        offsets = curve[:, None] - shape.points[None]
        if (np.hypot(offsets[..., 0], offsets[..., 1]).min(axis=1) > limit).any():
            return "drawn too much"
    return ""


class Counts(NamedTuple):
    """Results of all drawings.

    totals: number of drawings and of shapes of each kind.
    silent: number of silent differences of each feature and kind.
    places: a drawing and its shape with each of them.
    """

    totals: Counter[str]
    silent: Counter[tuple[str, str]]
    places: dict[tuple[str, str], str]


def compare(drawing: Drawing, shapes: list[Shape], reading: Reading, counts: Counts) -> None:
    """Counts the shapes of a drawing."""
    for shape, layers, feature in zip(shapes, drawing.layers, drawing.features, strict=True):
        counts.totals["shapes"] += 1
        counts.totals["drawn"] += len(shape.points) > 0
        curves = [points for layer, points in reading.curves if layer in layers]
        difference = describe_difference(shape, curves)
        if not difference:
            counts.totals["alike"] += 1
        elif any(layer in reading.notes for layer in layers):
            counts.totals["named"] += 1
        else:
            counts.totals["silent"] += 1
            kind = (feature, reading.fault.partition(":")[0] or difference)
            counts.silent[kind] += 1
            counts.places.setdefault(kind, f"{drawing.page} page, {min(layers)}")


def count_shapes(number: int, first: int, reader: Reader) -> Counts:
    """Draws and reads the drawings of all seeds."""
    counts = Counts(Counter(), Counter(), {})
    with start_browser() as browser, tempfile.TemporaryDirectory() as folder:
        page = browser.new_page()
        for seed in range(first, first + number):
            drawing = draw(seed)
            file = Path(folder) / f"drawing-{seed}.svg"
            file.write_text(drawing.text, encoding="utf-8")
            shapes, height = measure(page, file, drawing)
            reading = reader(file, height)
            counts.totals["drawings"] += 1
            counts.totals["failed"] += bool(reading.fault)
            before = set(counts.places)
            compare(drawing, shapes, reading, counts)
            for kind in counts.places.keys() - before:
                counts.places[kind] = f"seed {seed}, {counts.places[kind]}"
    return counts


def main(number: int, first: int, name: str) -> int:
    """Prints the tables. Returns 1 if a difference of camgen is silent or a drawing fails."""
    counts = count_shapes(number, first, READERS[name])
    heads = ("drawings", "failed", "shapes", "drawn", "alike", "named", "silent")
    table = open_table(" | ".join(f"{head} {{}}" for head in heads), f", {name}")
    cells: list[object] = [counts.totals[head] for head in heads]
    if name == "camgen" and counts.totals["silent"]:
        cells[-1] = Missed(f"{counts.totals['silent']}")
    if name == "camgen" and counts.totals["failed"]:
        cells[1] = Missed(f"{counts.totals['failed']}")
    table.add(*cells)
    if counts.silent:
        features = Table("feature | difference | shapes {} | for example")
        for kind, shapes in counts.silent.most_common():
            features.add(*kind, shapes, counts.places[kind])
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(100, 1, "camgen")))
