"""SVG drawings: paths and shapes as contours, in mm, y up, from the lower left corner of the page (docs/inputs/svg.md).

SVG 1.1 second edition, and of CSS what decides whether a shape is seen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.limits import Limits, tell
from camgen.model.part import Contour, Note, Part
from camgen.model.pose import FloatArray
from camgen.model.text import harmless, short
from camgen.read import join, units
from camgen.read.colors import count_colors
from camgen.read.dxf.layers import NOT_ASKED, Layers
from camgen.read.files import Files
from camgen.read.open_outlines import find_open_outlines
from camgen.read.pieces import tally
from camgen.read.svg.flatten import flatten
from camgen.read.svg.tree import DrawnShape, walk
from camgen.read.svg.values import (
    MM_PER_PX,
    Malformed,
    ViewBox,
    combine,
    fit_viewport,
    length,
    view_box,
)

_DEFAULTS = Limits()

# The page of an SVG document: mm of its units, and where the work frame lies on it.

#: Units that only ``input.units`` of an SVG takes, mm.
_MORE = {"px": MM_PER_PX, "pt": 25.4 / 72, "pc": 25.4 / 6}
_OVERRIDE = "set input.units if that is not meant"
#: Inkscape before 0.92 took 90 px for an inch.
_OLD_INKSCAPE = ("0.4", "0.91")
_VERSION = "{http://www.inkscape.org/namespaces/inkscape}version"


class SvgPage(Struct, frozen=True, eq=False):
    """matrix: (2, 3), mm in the work frame of the document's user units. view: of the viewport in user units.

    open: the document states no height, so that its lower left corner is not known.
    """

    matrix: FloatArray
    view: tuple[float, float]
    units: str
    told: str
    open: bool
    notes: tuple[Note, ...]


def page_of(
    file: str, attributes: Mapping[str, str], wanted: str, limits: Limits = _DEFAULTS
) -> SvgPage:
    """The page by width, height, viewBox and preserveAspectRatio, or by ``input.units`` where it is given."""
    try:
        box = view_box(attributes.get("viewBox"))
        sizes = _sizes(attributes, box, limits.svg_page)
        asked = wanted.strip().lower()
        if asked != "auto":
            scale = _MORE[asked] if asked in _MORE else units.resolve(file, wanted, 0, None)[1]
            return _even(asked, scale, box, sizes, ())
        if sizes is None:
            why = f"the file states no size; {_OVERRIDE}"
            note = Note("assumed", f"1 unit = {short(MM_PER_PX, 6)} mm (96 DPI)", why)
            return _even(f"{short(MM_PER_PX, 9)} mm/unit", MM_PER_PX, box, None, (note,))
        notes = _pixels(attributes)
        if box is None:
            return _even(f"{short(MM_PER_PX, 9)} mm/unit", MM_PER_PX, None, sizes, notes)
        aspect = attributes.get("preserveAspectRatio", "")
        matrix = fit_viewport(box, sizes[0] * MM_PER_PX, sizes[1] * MM_PER_PX, aspect)
        return _page(matrix, sizes[1] * MM_PER_PX, box, sizes, notes)
    except Malformed as error:
        raise InputError(
            file, str(error), "the svg element", "mend it, or save the drawing again"
        ) from error


def _sizes(
    attributes: Mapping[str, str], box: ViewBox | None, most: float
) -> tuple[float, float] | None:
    """Width and height in px; None where the file leaves them to whoever shows it. One follows from the other."""
    given: list[float | None] = []
    for name in ("width", "height"):
        text = attributes.get(name, "").strip()
        if not text or text == "auto" or text.endswith("%"):
            given.append(None)
            continue
        value = length(text, name, (0.0, 0.0))
        if value <= 0:
            raise Malformed(f"{name} is not above 0")
        if value * MM_PER_PX > most:
            raise Malformed(f"{name} is beyond {tell(most)} mm (limits.svg_page)")
        given.append(value)
    width, height = given
    if width is not None and height is not None:
        return width, height
    if box is None:
        return None
    if width is not None:
        return width, width * box.height / box.width
    return None if height is None else (height * box.width / box.height, height)


def _pixels(attributes: Mapping[str, str]) -> tuple[Note, ...]:
    """Notes on a size in px: what an inch is in them was not always the same."""
    if not all(
        attributes.get(name, "0")[-1].isdigit() or attributes[name].endswith("px")
        for name in ("width", "height")
    ):
        return ()
    version = attributes.get(_VERSION, "").split(" ")[0]
    if version.startswith("0.") and _OLD_INKSCAPE[0] <= version <= _OLD_INKSCAPE[1] + ".9":
        what = f"written by Inkscape {version[:8]}, which took 90 px for an inch"
        return (
            Note(
                "warning",
                what,
                "96 are assumed; set input.units or page.scale if the size is wrong",
            ),
        )
    return (Note("assumed", "96 px = 1 inch", f"the file's size is in px; {_OVERRIDE}"),)


def _even(
    name: str,
    scale: float,
    box: ViewBox | None,
    sizes: tuple[float, float] | None,
    notes: tuple[Note, ...],
) -> SvgPage:
    """A page on which one unit is ``scale`` mm."""
    if box is None:
        width, height = sizes or (0.0, 0.0)
        box = ViewBox(0.0, 0.0, width, height)
    matrix = np.array([[scale, 0.0, -box.x * scale], [0.0, scale, -box.y * scale]])
    return _make(matrix, box.height * scale, (box.width, box.height), name, notes)


def _page(
    matrix: FloatArray,
    height: float,
    box: ViewBox,
    sizes: tuple[float, float],
    notes: tuple[Note, ...],
) -> SvgPage:
    """A page whose box is laid into its size."""
    sx, sy = float(matrix[0, 0]), float(matrix[1, 1])
    name = (
        f"{short(sx, 9)} mm/unit"
        if abs(sx - sy) <= 1e-9 * sx
        else f"{short(sx, 6)} and {short(sy, 6)} mm/unit"
    )
    if abs(sx - 1) <= 1e-6 and abs(sy - 1) <= 1e-6:
        name = "mm"
    page = _make(matrix, height, (box.width, box.height), name, notes)
    told = " x ".join(short(v * MM_PER_PX, 3) for v in sizes) + " mm"
    return SvgPage(page.matrix, page.view, page.units, told, page.open, page.notes)


def _make(
    matrix: FloatArray, height: float, view: tuple[float, float], name: str, notes: tuple[Note, ...]
) -> SvgPage:
    """With y turned up, from the lower edge of the page."""
    up = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, height]])
    known = height > 0
    told = (
        f"{short(view[0] * float(matrix[0, 0]), 3)} x {short(height, 3)} mm"
        if known
        else "of no stated size"
    )
    return SvgPage(combine(up, matrix), view, name, told, not known, notes)


class SvgFacts(Struct, frozen=True):
    """What is in an SVG file; its ``str`` is a page to print. size: of the drawing, mm. notes as of ``read``. colors:
    of contours, where they have several.
    """

    units: str
    page: str
    layers: tuple[tuple[str, str, str], ...]
    counts: str
    closed: int
    open: int
    size: tuple[float, float]
    notes: tuple[Note, ...]
    colors: str

    def __str__(self) -> str:
        width, height = (short(v, 3) for v in self.size)
        lines = [
            f"SVG, units {self.units}, page {self.page}, drawing {width} x {height} mm",
            f"elements: {self.counts}",
            f"contours: {self.closed} closed, {self.open} open",
            *(f"layer {name}: {state}; {counts}" for name, state, counts in self.layers),
            *filter(None, [self.colors]),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Read(Struct, frozen=True):
    units: str
    page: str
    drawn: DrawnShape
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]


def read(source: Source, job: Job, _files: Files) -> Part:
    """The drawing in ``source``, read with ``[input]``; curves within ``tolerance.chord``.

    ``InputError`` if it cannot be read or holds nothing to draw, ``JobError`` for unknown units or layers.
    """
    found = _read(source, job)
    if not found.contours:
        left = "; ".join(
            f"{n.what}: {n.why}" for n in found.notes if n.kind in ("skipped", "repaired")
        )
        raise InputError(
            source.name,
            "nothing to machine",
            left or "the drawing is empty",
            "draw paths or shapes",
        )
    return Part(
        source.stem,
        source.name,
        found.units,
        found.contours,
        found.notes,
        open_outlines=find_open_outlines(found.contours, job),
    )


def inspect(source: Source, job: Job, _files: Files) -> SvgFacts:
    """What is in the drawing. Errors as of ``read``, but a drawing may be empty."""
    found = _read(source, job)
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {}
    for (kind, layer), count in found.drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer, Counter())[kind] += count
    why_not = found.drawn.layers.why_not
    layers = tuple(
        (harmless(name), why_not(name) or "used", _list_counts(by_layer[name]))
        for name in sorted(by_layer)
    )
    closed = sum(c.closed for c in found.contours)
    points = (
        np.concatenate([c.points for c in found.contours]) if found.contours else np.zeros((1, 2))
    )
    width, height = np.ptp(points, axis=0).tolist()
    opened = len(found.contours) - closed
    colors = count_colors([c.color for c in found.contours])
    counts = _list_counts(kinds)
    return SvgFacts(
        found.units,
        found.page,
        layers,
        counts,
        closed,
        opened,
        (width, height),
        found.notes,
        colors,
    )


def _read(source: Source, job: Job) -> _Read:
    settings = job.input
    root = _parse(source)
    page = page_of(source.name, root.attrib, settings.units, source.limits)
    layers = Layers({}, {}, tuple(glob.strip() for glob in settings.layers))
    # Damaged files hold infinities; what comes of them is found and told.
    with np.errstate(all="ignore"):
        drawn = walk(source.name, root, page.matrix, page.view, layers, source.limits)
        layers.check(source.name)
        contours, joints = join.contours(
            flatten(drawn, job.tolerance.chord), settings.join, job.chooses_colors
        )
    contours, notes = _from_corner(contours) if page.open else (contours, ())
    return _Read(
        page.units, page.told, drawn, contours, (*page.notes, *notes, *_left(drawn), *joints)
    )


def _parse(source: Source) -> ElementTree.Element:
    """The root element. A document that defines entities is refused: they can make any file of one."""
    name, data, most = source.name, source.data, source.limits.svg_bytes
    if len(data) > most:
        what = f"has more than {tell(most)} bytes"
        raise InputError(name, what, remedy="split the drawing, or raise limits.svg_bytes")
    if data[:2] == b"\x1f\x8b":
        raise InputError(name, "is compressed (.svgz)", remedy="decompress it with gzip")
    if not data.strip():
        raise InputError(name, "is empty")
    if b"<!ENTITY" in data.replace(b"\0", b""):
        what = "defines entities in its DOCTYPE, which camgen does not expand"
        raise InputError(name, what, remedy="save it as plain SVG")
    try:
        root = ElementTree.fromstring(data)
    except (
        ElementTree.ParseError,
        ValueError,
        LookupError,
    ) as error:  # LookupError: an encoding nobody knows
        raise InputError(
            name, f"is not well-formed XML: {error}", remedy="save it again"
        ) from error
    if root.tag != "{http://www.w3.org/2000/svg}svg":
        what = (
            "has no namespace of SVG"
            if root.tag == "svg"
            else f"is XML, but no SVG: <{harmless(root.tag, 60)}>"
        )
        raise InputError(
            name, what, remedy='the first element is <svg xmlns="http://www.w3.org/2000/svg">'
        )
    return root


def _from_corner(contours: tuple[Contour, ...]) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """A drawing on no page begins at its own lower left corner."""
    if not contours:
        return contours, ()
    low = np.min([c.points.min(axis=0) for c in contours], axis=0)
    moved = tuple(replace(c, points=_freeze(c.points - low)) for c in contours)
    return moved, (
        Note("assumed", "the origin is the drawing's own lower left corner", "it states no page"),
    )


def _freeze(points: FloatArray) -> FloatArray:
    points.flags.writeable = False
    return points


def _list_counts(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items())) or "none"


def _left(drawn: DrawnShape) -> list[Note]:
    """One note per reason for which something was not used, and for what was taken for something simpler."""
    notes = []
    for why, counts in drawn.left.items():
        kinds, layers = (
            [kind for kind, _ in counts.elements()],
            [layer for _, layer in counts if layer],
        )
        what = (
            tally(kinds, layers)
            if layers
            else ", ".join(f"{n} {kind}" for kind, n in Counter(kinds).items())
        )
        if why == NOT_ASKED:
            notes.append(Note("assumed", f"not used: {what}", why))
        else:
            notes.append(Note("skipped", what, why))
    effects = +drawn.effects
    if effects:
        notes.append(Note("skipped", _list_counts(effects), "curves are drawn whole and plain"))
    if drawn.dashed:
        notes.append(Note("assumed", f"with dashes: {drawn.dashed}", "the whole line is drawn"))
    return notes
