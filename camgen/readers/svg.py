"""SVG drawings: paths and shapes as contours, in mm, y up, from the lower left corner of the page (docs/inputs/svg.md).

SVG 1.1 second edition, and of CSS what decides whether a shape is seen.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.pose import FloatArray
from camgen.readers import join
from camgen.readers.dxf_layers import NOT_ASKED, Layers
from camgen.readers.pieces import tally
from camgen.readers.svg_flat import flatten
from camgen.readers.svg_page import page_of
from camgen.readers.svg_tree import Drawn, walk
from camgen.settings import Input, Job
from camgen.shapes import Contour, Note, Part
from camgen.text import harmless, short

_DEFAULTS = Job()
_MOST_BYTES = 200_000_000


class Facts(Struct, frozen=True):
    """What is in an SVG file; its ``str`` is a page to print. size: of the drawing, mm. notes as of ``read``."""

    units: str
    page: str
    layers: tuple[tuple[str, str, str], ...]
    counts: str
    closed: int
    open: int
    size: tuple[float, float]
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        width, height = (short(v, 3) for v in self.size)
        lines = [
            f"SVG, units {self.units}, page {self.page}, drawing {width} x {height} mm",
            f"elements: {self.counts}",
            f"contours: {self.closed} closed, {self.open} open",
            *(f"layer {name}: {state}; {counts}" for name, state, counts in self.layers),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Read(Struct, frozen=True):
    units: str
    page: str
    drawn: Drawn
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]


def read(path: Path, job: Job) -> Part:
    """The drawing at ``path``, read with ``[input]``; curves within ``tolerance.chord``.

    ``InputError`` if it cannot be read or holds nothing to draw, ``JobError`` for unknown units or layers.
    """
    found = _read(path, job.input, job.tolerance.chord)
    if not found.contours:
        left = "; ".join(f"{n.what}: {n.why}" for n in found.notes if n.kind in ("skipped", "repaired"))
        raise InputError(path.name, "nothing to machine", left or "the drawing is empty", "draw paths or shapes")
    return Part(path.stem, path.name, found.units, found.contours, found.notes)


def inspect(path: Path, job: Job = _DEFAULTS) -> Facts:
    """What is in the file at ``path``. Errors as of ``read``, but a drawing may be empty."""
    found = _read(path, job.input, job.tolerance.chord)
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {}
    for (kind, layer), count in found.drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer, Counter())[kind] += count
    why_not = found.drawn.layers.why_not
    layers = tuple((harmless(name), why_not(name) or "used", _listed(by_layer[name])) for name in sorted(by_layer))
    closed = sum(c.closed for c in found.contours)
    points = np.concatenate([c.points for c in found.contours]) if found.contours else np.zeros((1, 2))
    width, height = np.ptp(points, axis=0).tolist()
    opened = len(found.contours) - closed
    return Facts(found.units, found.page, layers, _listed(kinds), closed, opened, (width, height), found.notes)


def _read(path: Path, settings: Input, chord: float) -> _Read:
    root = _parsed(path)
    page = page_of(path.name, root.attrib, settings.units)
    layers = Layers({}, {}, tuple(g.strip().casefold() for g in settings.layers))
    # Damaged files hold infinities; what comes of them is found and told.
    with np.errstate(all="ignore"):
        drawn = walk(path.name, root, page.matrix, page.view, layers)
        layers.check(path.name)
        contours, joints = join.contours(flatten(drawn, chord), settings.join)
    contours, notes = _from_corner(contours) if page.open else (contours, ())
    return _Read(page.units, page.told, drawn, contours, (*page.notes, *notes, *_left(drawn), *joints))


def _parsed(path: Path) -> ElementTree.Element:
    """The root element. A document that defines entities is refused: they can make any file of one."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(path.name, f"has more than {_MOST_BYTES:,} bytes", remedy="split the drawing")
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        raise InputError(path.name, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if data[:2] == b"\x1f\x8b":
        raise InputError(path.name, "is compressed (.svgz)", remedy="decompress it with gzip")
    if not data.strip():
        raise InputError(path.name, "is empty")
    if b"<!ENTITY" in data.replace(b"\0", b""):
        what = "defines entities in its DOCTYPE, which camgen does not expand"
        raise InputError(path.name, what, remedy="save it as plain SVG")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an encoding nobody knows
        raise InputError(path.name, f"is not well-formed XML: {error}", remedy="save it again") from error
    if root.tag != "{http://www.w3.org/2000/svg}svg":
        what = "has no namespace of SVG" if root.tag == "svg" else f"is XML, but no SVG: <{harmless(root.tag, 60)}>"
        raise InputError(path.name, what, remedy='the first element is <svg xmlns="http://www.w3.org/2000/svg">')
    return root


def _from_corner(contours: tuple[Contour, ...]) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """A drawing on no page begins at its own lower left corner."""
    if not contours:
        return contours, ()
    low = np.min([c.points.min(axis=0) for c in contours], axis=0)
    moved = tuple(Contour(_fixed(c.points - low), c.bulges, c.closed, c.layer, c.id) for c in contours)
    return moved, (Note("assumed", "the origin is the drawing's own lower left corner", "it states no page"),)


def _fixed(points: FloatArray) -> FloatArray:
    points.flags.writeable = False
    return points


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items())) or "none"


def _left(drawn: Drawn) -> list[Note]:
    """One note per reason for which something was not used, and for what was taken for something simpler."""
    notes = []
    for why, counts in drawn.left.items():
        kinds, layers = [kind for kind, _ in counts.elements()], [layer for _, layer in counts if layer]
        what = tally(kinds, layers) if layers else ", ".join(f"{n} {kind}" for kind, n in Counter(kinds).items())
        if why == NOT_ASKED:
            notes.append(Note("assumed", f"not used: {what}", why))
        else:
            notes.append(Note("skipped", what, why))
    effects = +drawn.effects
    if effects:
        notes.append(Note("skipped", _listed(effects), "curves are drawn whole and plain"))
    if drawn.dashed:
        notes.append(Note("assumed", f"with dashes: {drawn.dashed}", "the whole line is drawn"))
    return notes
