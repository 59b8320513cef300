"""DXF drawings, ASCII and binary, R12 to R2018: the curves of model space as contours, or as curves in space.

``docs/inputs/dxf.md`` tells what is used, how ends are joined and what each note means.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
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
from camgen.read.dxf.layers import NOT_ASKED, layers_of
from camgen.read.extent import measure_box
from camgen.read.files import Files
from camgen.read.marks import Mark, add_marks
from camgen.read.open_outlines import find_open_outlines
from camgen.read.pieces import FARTHEST, describe_elements

if TYPE_CHECKING:
    from ezdxf.document import Drawing


#: Curves that are named one by one for a reason not to use them; the others are counted.
_NAMED = 5
_NOT_DRILLED = 'a place to drill, by operation.kind = "drill" without operation.holes'
_NOT_CREDIBLE = "its numbers are not finite or not credible"
#: Layers that every document has, whether the file names them or not.
_ALWAYS = {"0", "defpoints"}


class LayerFacts(Struct, frozen=True):
    """A layer: name, state ("used", or why not) and how many entities of each kind it has, blocks expanded."""

    name: str
    state: str
    counts: tuple[tuple[str, int], ...]


class DxfFacts(Struct, frozen=True):
    """What is in a DXF file; its ``str`` is a page to print.

    closed and open: contours after joining; space: curves that leave the plane; colors: of contours, where they have
    several; size: mm; notes as of ``read``.
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
        width, height = (short(v, 3) for v in self.size[:2])
        lines = [
            f"DXF {self.version}, units {self.units}, used part {width} x {height} mm",
            f"entities: {_list_counts(self.counts)}",
            f"contours: {self.closed} closed, {self.open} open"
            + (f"; {counted(self.space, 'curve')} in space" if self.space else ""),
            *(
                f"layer {layer.name}: {layer.state}; {_list_counts(layer.counts)}"
                for layer in self.layers
            ),
            *filter(None, [self.colors]),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Read(Struct, frozen=True):
    version: str
    units: str
    drawn: DrawnEntities
    contours: tuple[Contour, ...]
    curves: tuple[Curve, ...]
    space: int
    size: tuple[float, ...]
    about_file: tuple[Note, ...]
    left: tuple[Note, ...]
    unplaced: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.about_file + self.left


def read(source: Source, job: Job, _files: Files) -> Part:
    """The drawing in ``source``, read with ``[input]``; ellipses and splines within ``tolerance.chord``.

    Where a curve leaves the plane and is to be traced, off any page, all of the drawing is read as curves in space.
    ``InputError`` if it cannot be read or holds nothing to machine, ``JobError`` for unknown units or layers.
    """
    name = source.name
    found = _read(source, job)
    if not found.contours and not found.curves:
        damage = [n.what for n in found.about_file if n.kind in {"repaired", "skipped", "warning"}]
        left = "; ".join([*damage, *(f"{n.what}: {n.why}" for n in found.left)])
        empty, remedy = "the drawing is empty", "draw curves on a visible layer"
        if found.unplaced:
            empty += f": {_list_unplaced(found.unplaced)}"
            remedy = "insert its block in model space"
        raise InputError(name, "nothing to machine", left or empty, remedy)
    return Part(
        source.stem,
        name,
        found.units,
        found.contours,
        found.notes,
        curves=found.curves,
        open_outlines=find_open_outlines(found.contours, job),
    )


def inspect(source: Source, job: Job, _files: Files) -> DxfFacts:
    """What is in the drawing. ``InputError`` if it cannot be read, ``JobError`` as for ``read``."""
    found = _read(source, job)
    drawn = found.drawn
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {name: Counter() for name in drawn.layers.names}
    for (kind, layer), count in drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer.casefold(), Counter())[kind] += count
    layers = tuple(
        LayerFacts(
            harmless(drawn.layers.names[key]),
            drawn.layers.why_not(drawn.layers.names[key]) or "used",
            counts,
        )
        for key, counts in ((key, tuple(sorted(by_layer[key].items()))) for key in sorted(by_layer))
        if counts or key not in _ALWAYS
    )
    closed = sum(c.closed for c in found.contours)
    return DxfFacts(
        version=found.version,
        units=found.units,
        layers=layers,
        counts=tuple(sorted(kinds.items())),
        closed=closed,
        open=len(found.contours) - closed,
        space=found.space,
        size=found.size,
        notes=found.notes,
        colors=count_colors([c.color for c in found.contours]),
    )


def _read(source: Source, job: Job) -> _Read:
    name, data, settings, chord = source.name, source.data, job.input, job.tolerance.chord
    loaded = load_document(name, data)
    document, notes = loaded.document, loaded.notes
    version = f"{document.dxfversion} ({document.acad_release})"
    unit, scale, unit_notes = units.resolve(name, settings.units, *_state(name, document, data))
    layers = layers_of(document, job)
    contours: tuple[Contour, ...] = ()
    curves: tuple[Curve, ...] = ()
    # Damaged files hold infinities; what comes of them is found and told by name.
    with np.errstate(invalid="ignore", over="ignore"):
        drawn = walk(name, document, loaded.plain, scale, layers, source.limits)
        layers.check(name)
        unplaced = () if drawn.met else _list_blocks(document)
        # The document is the largest thing in memory and no longer needed.
        del document, loaded
        flat = flatten(drawn, chord)
        if flat.tilted and _is_meant_in_space(job):
            _add_marks(drawn, (), job)
            curves, joints = space.join_pieces(
                place_in_space(name, drawn, chord, source.limits), settings.join
            )
            left = (
                *_left(drawn),
                *_take(drawn),
                *joints,
                *([space.note_heights(curves)] if curves else []),
            )
        else:
            contours, joints = join.contours_of(flat.soup, job)
            contours, marked = _add_marks(drawn, contours, job)
            left = (*_left(drawn), *_not_flat(drawn, flat), *_level(flat), *_take(drawn), *marked)
            left += (*_note_gaps(drawn, flat, settings.join), *joints)
    size = _measure_size(contours, curves)
    is_read = bool(contours or curves)
    has_own_unit = settings.units.strip().lower() == "auto"
    doubts = units.note_doubtful_size(size, unit, name) if is_read and has_own_unit else ()
    about_file = (*notes, *unit_notes, *doubts)
    return _Read(
        version,
        unit,
        drawn,
        contours,
        curves,
        len(flat.tilted),
        size[:2],
        about_file,
        left,
        unplaced,
    )


def _list_unplaced(blocks: tuple[str, ...]) -> str:
    names = ", ".join(repr(harmless(block)) for block in blocks[:_NAMED])
    if len(blocks) > _NAMED:
        names += f" and {len(blocks) - _NAMED} more"
    verb = "block {} is" if len(blocks) == 1 else "blocks {} are"
    return verb.format(names) + " nowhere placed"


def _list_blocks(document: Drawing) -> tuple[str, ...]:
    """Names of the blocks that hold something, except layouts and anonymous ones."""
    blocks = (block for block in document.blocks if not block.is_any_layout)
    return tuple(block.name for block in blocks if len(block) and not block.name.startswith("*"))


def _add_marks(
    drawn: DrawnEntities, contours: tuple[Contour, ...], job: Job
) -> tuple[tuple[Contour, ...], list[Note]]:
    """The contours with circles for the points that are drilled; the others are counted as left."""
    if not drawn.point_owner:
        return contours, []
    matrices = np.array([drawn.matrices[drawn.matrix[k]] for k in drawn.point_owner])
    local = np.array(drawn.points).reshape(-1, 3)
    places = np.einsum("nij,nj->ni", matrices[:, :2, :3], local) + matrices[:, :2, 3]
    marks = []
    for owner, (x, y) in zip(drawn.point_owner, places.tolist(), strict=True):
        if max(abs(x), abs(y)) <= FARTHEST:
            marks.append(Mark(x, y, drawn.layer[owner], drawn.colors.names[drawn.color[owner]]))
        else:
            drawn.leave(_NOT_CREDIBLE, "POINT", drawn.layer[owner])
    contours, others, notes = add_marks(contours, marks, job)
    for mark in others:
        drawn.leave(_NOT_DRILLED, "POINT", mark.layer)
    return contours, notes


def _is_meant_in_space(job: Job) -> bool:
    """Whether curves that leave the plane are to be followed: a page is flat, and so is all but tracing."""
    return job.operation.kind == "trace" and not job.page.size


def _state(name: str, document: Drawing, data: bytes) -> tuple[int, int | None]:
    """$INSUNITS (0: none) and $MEASUREMENT of the header, None if there is none.

    ezdxf fills a header that is missing with defaults (metres), hence the look at the bytes.
    """
    found: list[int | None] = []
    for key in ("$INSUNITS", "$MEASUREMENT"):
        value = document.header.get(key, 0) if key.encode() in data else None
        try:
            found.append(None if value is None else int(value))
        except ValueError as error:
            remedy = "save it again from the CAD program, or mend the header"
            raise InputError(
                name, f"is damaged: {str(value)[:20]!r} is no number", key, remedy
            ) from error
    insunits, measurement = found
    return insunits or 0, measurement


def _measure_size(contours: tuple[Contour, ...], curves: tuple[Curve, ...]) -> tuple[float, ...]:
    """Along x and y, of curves in space along z too, mm; 0 without contours and curves."""
    if not contours and not curves:
        return 0.0, 0.0
    low, high = measure_box(contours, curves)
    heights = [np.concatenate([curve.points, curve.middles])[:, 2] for curve in curves]
    tall = [float(np.ptp(np.concatenate(heights)))] if heights else []
    return (*(high - low).tolist(), *tall)


def _list_counts(counts: tuple[tuple[str, int], ...]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts) or "none"


def _count(counts: Counter[tuple[str, str]]) -> str:
    return describe_elements(
        [kind for kind, _ in counts.elements()], [layer for _, layer in counts]
    )


def _left(drawn: DrawnEntities) -> list[Note]:
    """One note per reason for which entities were not used."""
    notes = []
    for why, counts in drawn.left.items():
        if why == NOT_ASKED:
            notes.append(Note("assumed", f"not used: {_count(counts)}", why))
        elif why in REPAIRED:
            notes.append(Note("repaired", f"dropped: {_count(counts)}", why))
        else:
            notes.append(Note("skipped", _count(counts) + _list_handles(drawn, why), why))
    return notes


def _list_handles(drawn: DrawnEntities, why: str) -> str:
    """Handles of entities that are not used, as far as a note has them; "" without any."""
    handles = drawn.handles.get(why, [])
    if not handles:
        return ""
    more = f" and {len(handles) - _NAMED} more" if len(handles) > _NAMED else ""
    return ": " + ", ".join(f"#{harmless(handle)}" for handle in handles[:_NAMED]) + more


def _not_flat(drawn: DrawnEntities, flat: Flat) -> list[Note]:
    """Notes on curves that leave the plane, by name, and on those whose numbers make no curve."""
    notes = []
    if flat.damaged:
        names = [f"{_name(drawn, k)} on layer {harmless(drawn.layer[k])}" for k in flat.damaged]
        rest = f"; and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        notes.append(Note("skipped", "; ".join(names[:_NAMED]) + rest, _NOT_CREDIBLE))
    if flat.tilted:
        named = [
            f"{_name(drawn, i)} on layer {harmless(drawn.layer[i])} leaves the plane by {short(height, 3)} mm"
            for i, height in sorted(flat.tilted.items())[:_NAMED]
        ]
        more = len(flat.tilted) - len(named)
        what = "; ".join(named) + (f"; and {more} more" if more else "")
        why = "curves must be flat and parallel to the XY plane; nothing is projected"
        notes.append(
            Note("skipped", what, f'{why}; operation.kind = "trace" follows them in space')
        )
    return notes


def _note_gaps(drawn: DrawnEntities, flat: Flat, tolerance: float) -> list[Note]:
    """A note on splines that are marked closed and are open by more than `tolerance` mm."""
    wide = {owner: gap for owner, gap in flat.gaps.items() if gap > tolerance}
    if not wide:
        return []
    names = [
        f"{_name(drawn, owner)} on layer {harmless(drawn.layer[owner])} by {short(gap, 3)} mm"
        for owner, gap in sorted(wide.items())[:_NAMED]
    ]
    more = f"; and {len(wide) - _NAMED} more" if len(wide) > _NAMED else ""
    what = f"marked closed but open: {'; '.join(names)}{more}"
    return [Note("warning", what, "used as its points say; close it in the CAD program")]


def _name(drawn: DrawnEntities, owner: int) -> str:
    """A kind with its handle, where the file gives it one."""
    handle = drawn.handle[owner]
    return f"{drawn.kind[owner]} #{harmless(handle)}" if handle else drawn.kind[owner]


def _level(flat: Flat) -> list[Note]:
    """A note on heights, which a flat drawing has none of."""
    notes = []
    heights = flat.heights[np.isfinite(flat.heights)]
    low, high = float(heights.min(initial=0.0)), float(heights.max(initial=0.0))
    if max(-low, high) > FLAT_MM:
        low, high = float(heights.min()), float(heights.max())
        at = short(low, 3) if high - low <= FLAT_MM else f"{short(low, 3)} to {short(high, 3)}"
        notes.append(
            Note("assumed", f"curves drawn at z = {at} mm", "taken as lying in the work plane")
        )
    return notes


def _take(drawn: DrawnEntities) -> list[Note]:
    """Notes on what was taken for something simpler: thickness, widths."""
    notes = []
    if drawn.flattened:
        notes.append(
            Note(
                "assumed", f"with thickness: {_count(drawn.flattened)}", "the curve itself is used"
            )
        )
    if drawn.widths:
        notes.append(
            Note("assumed", f"with width: {_count(drawn.widths)}", "the centre line is used")
        )
    return notes
