"""SVG drawings: paths and shapes as contours, in mm, y up, from the lower left corner of the page.

The static geometry of SVG 2: transforms, viewports, references, styles of CSS (docs/inputs/svg.md).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.limits import format_limit
from camgen.model.part import Contour, Note, NoteKind, Part
from camgen.model.pose import frozen
from camgen.model.text import harmless
from camgen.read import join
from camgen.read.colors import count_colors
from camgen.read.files import Files
from camgen.read.layers import NOT_ASKED, Layers
from camgen.read.open_outlines import find_open_outlines
from camgen.read.pieces import describe_elements, format_counts, list_first
from camgen.read.svg.background import remove_background
from camgen.read.svg.flatten import flatten
from camgen.read.svg.page import SvgPage, find_page
from camgen.read.svg.tree import SWITCHED, Document, Drawing, walk
from camgen.read.units import format_size

#: Reasons for which something is left out as the job or the file asks; all others are losses.
_REQUESTED: dict[str, NoteKind] = {NOT_ASKED: "assumed", SWITCHED: "assumed"}
#: Ids that a note lists.
_LISTED_IDS = 3


class SvgFacts(Struct, frozen=True):
    """The contents of an SVG file; its `str` is a page to print.

    units: size of a user unit.
    page: size of the page.
    layers: name, use and counts of each layer.
    counts: shapes by kind.
    closed: number of closed contours.
    open: number of open contours.
    size: width and height of the drawing, mm.
    notes: notes of `read`.
    colors: number of contours by color; empty if all have the same.
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
        size = format_size(self.size)
        return "\n".join(
            [
                f"SVG, units {self.units}, page {self.page}, drawing {size} mm",
                f"elements: {self.counts}",
                f"contours: {self.closed} closed, {self.open} open",
                *(f"layer {name}: {state}; {counts}" for name, state, counts in self.layers),
                *filter(None, [self.colors]),
                *map(str, self.notes),
            ]
        )


class _Contents(Struct, frozen=True):
    """A drawing that was read.

    page: its page.
    drawing: results of the walk.
    contours: contours in drawing order.
    notes: losses, assumptions and repairs.
    """

    page: SvgPage
    drawing: Drawing
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]


def read(source: Source, job: Job, _files: Files) -> Part:
    """Reads a drawing with `[input]`; curves within `tolerance.chord`.

    Raises InputError if it cannot be read or holds nothing to draw, JobError for unknown units or
    layers.
    """
    contents = _read(source, job)
    if not contents.contours:
        losses = [note for note in contents.notes if note.kind in ("skipped", "repaired")]
        reasons = "; ".join(f"{note.what}: {note.why}" for note in losses)
        raise InputError(
            source.name,
            "nothing to machine",
            reasons or "the drawing is empty",
            "draw paths or shapes",
        )
    return Part(
        source.stem,
        source.name,
        contents.page.units,
        contents.contours,
        contents.notes,
        open_outlines=find_open_outlines(contents.contours, job),
    )


def inspect(source: Source, job: Job, _files: Files) -> SvgFacts:
    """Lists the contents of a drawing. Raises the errors of `read`, but a drawing may be empty."""
    contents = _read(source, job)
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {}
    for (kind, layer), count in contents.drawing.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer, Counter())[kind] += count
    why_not = contents.drawing.layers.why_not
    layers = tuple(
        (harmless(name), why_not(name) or "used", format_counts(by_layer[name]))
        for name in sorted(by_layer)
    )
    contours = contents.contours
    closed = sum(contour.closed for contour in contours)
    size = (0.0, 0.0)
    if contours:
        width, height = np.ptp(np.concatenate([c.points for c in contours]), axis=0).tolist()
        size = width, height
    return SvgFacts(
        contents.page.units,
        contents.page.size,
        layers,
        format_counts(kinds),
        closed,
        len(contours) - closed,
        size,
        contents.notes,
        count_colors([contour.color for contour in contours]),
    )


def _read(source: Source, job: Job) -> _Contents:
    settings = job.input
    document = Document(_parse(source))
    page = find_page(
        source.name, document.root.attrib, document.style, settings.units, source.limits
    )
    layers = Layers({}, {}, tuple(map(str.strip, settings.layers)), job.clamp_layers)
    # Damaged files hold infinities; their contours are dropped with a note.
    with np.errstate(all="ignore"):
        drawing = walk(source.name, document, page.matrix, page.view, layers, source.limits)
        layers.check(source.name)
        notes = [*page.notes, *remove_background(drawing, page.frames)]
        contours, joints = join.make_job_contours(flatten(drawing, job.tolerance.chord), job)
    if page.is_open:
        contours, moved = _from_corner(contours)
        notes += moved
    if b"<?xml-stylesheet" in source.data.replace(b"\0", b""):
        drawing.report("style sheets of other files are not read", "xml-stylesheet", "")
    notes += [*_list_reports(drawing), *joints]
    return _Contents(page, drawing, contours, tuple(notes))


def _parse(source: Source) -> ElementTree.Element:
    """The root element. A document with entities is refused: they can expand to any size."""
    name, data, limit = source.name, source.data, source.limits.svg_bytes
    if len(data) > limit:
        raise InputError(
            name,
            f"has more than {format_limit(limit)} bytes",
            remedy="split the drawing, or raise limits.svg_bytes",
        )
    if data[:2] == b"\x1f\x8b":
        raise InputError(name, "is compressed (.svgz)", remedy="decompress it with gzip")
    if not data.strip():
        raise InputError(name, "is empty")
    if b"<!ENTITY" in data.replace(b"\0", b""):
        raise InputError(
            name,
            "defines entities in its DOCTYPE, which camgen does not expand",
            remedy="save it as plain SVG",
        )
    try:
        root = ElementTree.fromstring(data)
    except (
        ElementTree.ParseError,
        ValueError,
        LookupError,
    ) as error:  # LookupError: an unknown encoding
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
    moved = tuple(replace(c, points=frozen(c.points - low)) for c in contours)
    return moved, (
        Note("assumed", "the origin is the drawing's own lower left corner", "it states no page"),
    )


def _list_reports(drawing: Drawing) -> Iterator[Note]:
    """One note per reason for which something was not used, or was read as something simpler."""
    for reason, counts in drawing.reports.items():
        kinds: Counter[str] = Counter()
        for (kind, _), count in counts.items():
            kinds[kind] += count
        what = describe_elements(kinds, [layer for _, layer in counts if layer])
        if reason in _REQUESTED:
            yield Note(_REQUESTED[reason], f"not used: {what}", reason)
        else:
            ids = [f"#{harmless(name, 40)}" for name in dict.fromkeys(drawing.ids.get(reason, ()))]
            listed = f": {list_first(ids, _LISTED_IDS)}" if ids else ""
            yield Note("skipped", what + listed, reason)
    if drawing.dashed:
        yield Note("assumed", f"with dashes: {drawing.dashed}", "the whole line is drawn")
