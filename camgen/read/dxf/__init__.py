"""Reads DXF drawings: the curves of model space, as flat contours or as curves in space.

ASCII and binary files from R12 to R2018. `docs/inputs/dxf.md` lists which entities are used, how
ends are joined, and the meaning of each note.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from ezdxf.document import Drawing
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Contour, Curve, Note, Part
from camgen.model.text import counted, harmless, short
from camgen.read import join, space, units
from camgen.read.colors import count_colors
from camgen.read.dxf.document import load_document
from camgen.read.dxf.entities import REPAIRED, DrawnEntities, walk
from camgen.read.dxf.flatten import FLAT_MM, Flat, flatten
from camgen.read.dxf.in_space import place_in_space
from camgen.read.dxf.layers import read_layers
from camgen.read.extent import measure_box
from camgen.read.files import Files
from camgen.read.layers import NOT_ASKED
from camgen.read.marks import Mark, add_marks
from camgen.read.open_outlines import find_open_outlines
from camgen.read.pieces import FARTHEST, describe_elements, format_counts, list_first

#: Curves and blocks that a note names one by one. The others are counted.
_NAMED = 5
_NOT_DRILLED = 'a place to drill, by operation.kind = "drill" without operation.holes'
_NOT_CREDIBLE = "its numbers are not finite or not credible"
#: Layers that every document has, even if the file does not name them.
_BUILT_IN_LAYERS = {"0", "defpoints"}


class LayerFacts(Struct, frozen=True):
    """A layer of a drawing.

    name: its name.
    state: "used", or why its curves are not.
    counts: kinds of its entities and the number of each, with blocks expanded.
    """

    name: str
    state: str
    counts: tuple[tuple[str, int], ...]


class DxfFacts(Struct, frozen=True):
    """The content of a DXF file. Its `str` is a page to print.

    version: version of the format, and the release of AutoCAD that introduced it.
    units: name of the unit in which it is drawn.
    layers: layers in order of their names.
    counts: kinds of entities and the number of each, with blocks expanded.
    closed: number of closed contours after joining.
    open: number of open contours after joining.
    space: number of curves that leave the plane.
    size: size of the used part along x and y, mm.
    notes: the notes of `read`.
    colors: number of contours by color; "" if there is only one color.
    """

    version: str
    units: str
    layers: tuple[LayerFacts, ...]
    counts: tuple[tuple[str, int], ...]
    closed: int
    open: int
    space: int
    size: tuple[float, ...]
    notes: tuple[Note, ...]
    colors: str = ""

    def __str__(self) -> str:
        contours = f"contours: {self.closed} closed, {self.open} open"
        if self.space:
            contours += f"; {counted(self.space, 'curve')} in space"
        lines = [
            f"DXF {self.version}, units {self.units}, used part {units.format_size(self.size)} mm",
            f"entities: {format_counts(dict(self.counts))}",
            contours,
        ]
        for layer in self.layers:
            lines.append(f"layer {layer.name}: {layer.state}; {format_counts(dict(layer.counts))}")
        if self.colors:
            lines.append(self.colors)
        return "\n".join([*lines, *map(str, self.notes)])


class _Drawing(Struct, frozen=True):
    """A drawing that was read.

    version: version of the format, and the release of AutoCAD that introduced it.
    units: name of the unit in which it is drawn.
    drawn: all entities.
    contours: the drawing as contours, empty if it was read in space.
    curves: the drawing as curves in space, empty if it was read flat.
    space: number of curves that leave the plane.
    size: size along x and y, mm; 0 without contours and curves.
    file_notes: notes on the file: its damage and its unit.
    entity_notes: notes on entities that are not used, or not as they are.
    unplaced: names of blocks that hold something, if the drawing places none of them.
    """

    version: str
    units: str
    drawn: DrawnEntities
    contours: tuple[Contour, ...]
    curves: tuple[Curve, ...]
    space: int
    size: tuple[float, ...]
    file_notes: tuple[Note, ...]
    entity_notes: tuple[Note, ...]
    unplaced: tuple[str, ...]


def read(source: Source, job: Job, _files: Files) -> Part:
    """The drawing in `source` as a part. Ellipses and splines deviate by `tolerance.chord` at most.

    If a curve leaves the plane and the job traces curves that are not on a page, the whole drawing
    is read as curves in space.

    Raises InputError if the file cannot be read or has nothing to machine, and JobError for unknown
    units or layers.
    """
    drawing = _read(source, job)
    if not drawing.contours and not drawing.curves:
        raise _report_empty(source.name, drawing)
    return Part(
        source.stem,
        source.name,
        drawing.units,
        drawing.contours,
        drawing.file_notes + drawing.entity_notes,
        curves=drawing.curves,
        open_outlines=find_open_outlines(drawing.contours, job),
    )


def _report_empty(name: str, drawing: _Drawing) -> InputError:
    reasons = [
        note.what for note in drawing.file_notes if note.kind in {"repaired", "skipped", "warning"}
    ]
    reasons += [f"{note.what}: {note.why}" for note in drawing.entity_notes]
    empty, remedy = "the drawing is empty", "draw curves on a visible layer"
    if drawing.unplaced:
        names = list_first([repr(harmless(block)) for block in drawing.unplaced], _NAMED)
        verb = "block {} is" if len(drawing.unplaced) == 1 else "blocks {} are"
        empty += f": {verb.format(names)} nowhere placed"
        remedy = "insert its block in model space"
    return InputError(name, "nothing to machine", "; ".join(reasons) or empty, remedy)


def inspect(source: Source, job: Job, _files: Files) -> DxfFacts:
    """The content of the drawing in `source`. Raises InputError and JobError as `read` does.

    A drawing with nothing to machine is not an error here.
    """
    drawing = _read(source, job)
    drawn = drawing.drawn
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {name: Counter() for name in drawn.layers.names}
    for (kind, layer), count in drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer.casefold(), Counter())[kind] += count
    layers = []
    for folded in sorted(by_layer):
        if by_layer[folded] or folded not in _BUILT_IN_LAYERS:
            name = drawn.layers.names[folded]
            counts = tuple(sorted(by_layer[folded].items()))
            layers.append(LayerFacts(harmless(name), drawn.layers.why_not(name) or "used", counts))
    closed = sum(contour.closed for contour in drawing.contours)
    return DxfFacts(
        version=drawing.version,
        units=drawing.units,
        layers=tuple(layers),
        counts=tuple(sorted(kinds.items())),
        closed=closed,
        open=len(drawing.contours) - closed,
        space=drawing.space,
        size=drawing.size,
        notes=drawing.file_notes + drawing.entity_notes,
        colors=count_colors([contour.color for contour in drawing.contours]),
    )


def _read(source: Source, job: Job) -> _Drawing:
    name, data, settings = source.name, source.data, job.input
    document, plain, notes = load_document(name, data)
    version = f"{document.dxfversion} ({document.acad_release})"
    unit, scale, unit_notes = units.resolve(
        name, settings.units, *_read_units(name, document, data)
    )
    layers = read_layers(document, job)
    # Numbers of a damaged file may be infinite. Their curves are found later and noted.
    with np.errstate(invalid="ignore", over="ignore"):
        drawn = walk(name, document, plain, scale, layers, source.limits)
        layers.check(name)
        unplaced = () if drawn.met else _list_blocks(document)
        # The document takes most of the memory and is no longer needed.
        del document, plain
        flat = flatten(drawn, job.tolerance.chord)
        contours: tuple[Contour, ...] = ()
        curves: tuple[Curve, ...] = ()
        # Pages are flat, and only tracing follows curves in space.
        if flat.tilted and job.operation.kind == "trace" and not job.page.size:
            curves, entity_notes = _make_curves(source, drawn, job)
        else:
            contours, entity_notes = _make_contours(drawn, flat, job)
    size = _measure_size(contours, curves)
    file_notes = (*notes, *unit_notes)
    if size and settings.units.strip().lower() == "auto":
        file_notes += units.note_doubtful_size(size, unit, name)
    return _Drawing(
        version,
        unit,
        drawn,
        contours,
        curves,
        len(flat.tilted),
        size[:2] or (0.0, 0.0),
        file_notes,
        entity_notes,
        unplaced,
    )


def _make_curves(
    source: Source, drawn: DrawnEntities, job: Job
) -> tuple[tuple[Curve, ...], tuple[Note, ...]]:
    _add_marks(drawn, (), job)
    pieces = place_in_space(source.name, drawn, job.tolerance.chord, source.limits)
    curves, joint_notes = space.join_pieces(pieces, job.input.join)
    notes = (*_note_unused(drawn), *_note_simplified(drawn), *joint_notes)
    return curves, (*notes, space.note_heights(curves)) if curves else notes


def _make_contours(
    drawn: DrawnEntities, flat: Flat, job: Job
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    contours, joint_notes = join.make_job_contours(flat.soup, job)
    contours, mark_notes = _add_marks(drawn, contours, job)
    notes = [*_note_unused(drawn), *_note_tilted_and_damaged(drawn, flat), *_note_heights(flat)]
    notes += [*_note_simplified(drawn), *mark_notes]
    notes += _note_open_splines(drawn, flat, job.input.join)
    return contours, (*notes, *joint_notes)


def _list_blocks(document: Drawing) -> tuple[str, ...]:
    """Names of the blocks that are not empty, except layouts and anonymous blocks."""
    blocks = [block for block in document.blocks if len(block) and not block.is_any_layout]
    return tuple(block.name for block in blocks if not block.name.startswith("*"))


def _add_marks(
    drawn: DrawnEntities, contours: tuple[Contour, ...], job: Job
) -> tuple[tuple[Contour, ...], list[Note]]:
    """The contours with a circle for each point that is drilled, and notes.

    The other points are counted as unused in `drawn`.
    """
    if not drawn.points:
        return contours, []
    matrices = np.array([drawn.matrices[drawn.matrix[owner]] for owner in drawn.points])
    local = np.array(list(drawn.points.values()))
    positions = np.einsum("nij,nj->ni", matrices[:, :2, :3], local) + matrices[:, :2, 3]
    marks = []
    for owner, (x, y) in zip(drawn.points, positions.tolist(), strict=True):
        if max(abs(x), abs(y)) <= FARTHEST:
            marks.append(Mark(x, y, drawn.layer[owner], drawn.colors.names[drawn.color[owner]]))
        else:
            drawn.count_unused(_NOT_CREDIBLE, "POINT", drawn.layer[owner])
    contours, unused, notes = add_marks(contours, marks, job)
    for mark in unused:
        drawn.count_unused(_NOT_DRILLED, "POINT", mark.layer)
    return contours, notes


def _read_units(name: str, document: Drawing, data: bytes) -> tuple[int, int | None]:
    """$INSUNITS and $MEASUREMENT of the header.

    $INSUNITS is 0 if the header has none, $MEASUREMENT is None. ezdxf replaces a missing header by
    defaults (metres), so the bytes are searched for the names.

    Raises InputError if one of them is not a number.
    """
    values: list[int | None] = []
    for key in ("$INSUNITS", "$MEASUREMENT"):
        if key.encode() not in data:
            values.append(None)
            continue
        value = document.header.get(key, 0)
        try:
            values.append(int(value))
        except ValueError as error:
            raise InputError(
                name,
                f"is damaged: {str(value)[:20]!r} is not a number",
                key,
                "save it again from the CAD program, or correct the header",
            ) from error
    insunits, measurement = values
    return insunits or 0, measurement


def _measure_size(contours: tuple[Contour, ...], curves: tuple[Curve, ...]) -> tuple[float, ...]:
    """Size along x and y, and along z if there are curves in space, mm; () without any."""
    if not contours and not curves:
        return ()
    lower, upper = measure_box(contours, curves)
    size = (upper - lower).tolist()
    if curves:
        heights = [np.concatenate([curve.points, curve.middles])[:, 2] for curve in curves]
        size.append(float(np.ptp(np.concatenate(heights))))
    return tuple(size)


def _tally(counts: Counter[tuple[str, str]]) -> str:
    return describe_elements(
        [kind for kind, _ in counts.elements()], [layer for _, layer in counts]
    )


def _note_unused(drawn: DrawnEntities) -> Iterator[Note]:
    for why, counts in drawn.unused.items():
        if why == NOT_ASKED:
            yield Note("assumed", f"not used: {_tally(counts)}", why)
        elif why in REPAIRED:
            yield Note("repaired", f"dropped: {_tally(counts)}", why)
        else:
            handles = [f"#{harmless(handle)}" for handle in drawn.handles.get(why, [])]
            listed = f": {list_first(handles, _NAMED)}" if handles else ""
            yield Note("skipped", _tally(counts) + listed, why)


def _note_tilted_and_damaged(drawn: DrawnEntities, flat: Flat) -> Iterator[Note]:
    if flat.damaged:
        damaged = [_name_entity(drawn, owner) for owner in flat.damaged]
        yield Note("skipped", list_first(damaged, _NAMED, "; ", "; "), _NOT_CREDIBLE)
    if flat.tilted:
        tilted = [
            f"{_name_entity(drawn, owner)} leaves the plane by {short(height, 3)} mm"
            for owner, height in sorted(flat.tilted.items())
        ]
        why = (
            "curves must be flat and parallel to the XY plane; nothing is projected; "
            'operation.kind = "trace" follows them in space'
        )
        yield Note("skipped", list_first(tilted, _NAMED, "; ", "; "), why)


def _note_open_splines(drawn: DrawnEntities, flat: Flat, tolerance: float) -> Iterator[Note]:
    """A note on splines that are marked closed but open by more than `tolerance` mm."""
    names = [
        f"{_name_entity(drawn, owner)} by {short(gap, 3)} mm"
        for owner, gap in sorted(flat.gaps.items())
        if gap > tolerance
    ]
    if names:
        yield Note(
            "warning",
            f"marked closed but open: {list_first(names, _NAMED, '; ', '; ')}",
            "used as its points say; close it in the CAD program",
        )


def _name_entity(drawn: DrawnEntities, owner: int) -> str:
    handle = drawn.handle[owner]
    name = f"{drawn.kind[owner]} #{harmless(handle)}" if handle else drawn.kind[owner]
    return f"{name} on layer {harmless(drawn.layer[owner])}"


def _note_heights(flat: Flat) -> Iterator[Note]:
    heights = flat.heights[np.isfinite(flat.heights)]
    if np.abs(heights).max(initial=0.0) > FLAT_MM:
        low, high = float(heights.min()), float(heights.max())
        span = short(low, 3) if high - low <= FLAT_MM else f"{short(low, 3)} to {short(high, 3)}"
        yield Note("assumed", f"curves drawn at z = {span} mm", "taken as lying in the work plane")


def _note_simplified(drawn: DrawnEntities) -> Iterator[Note]:
    if drawn.with_thickness:
        thick = f"with thickness: {_tally(drawn.with_thickness)}"
        yield Note("assumed", thick, "the curve itself is used")
    if drawn.with_width:
        wide = f"with width: {_tally(drawn.with_width)}"
        yield Note("assumed", wide, "the centre line is used")
