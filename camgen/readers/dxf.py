"""DXF drawings, ASCII and binary, R12 to R2018: the curves of model space as contours.

``docs/inputs/dxf.md`` tells what is used, how ends are joined and what each note means.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from camgen.content import readable
from camgen.errors import InputError
from camgen.readers import dxf_load, join, units
from camgen.readers.dxf_entities import REPAIRED, Drawn, walk
from camgen.readers.dxf_flat import FLAT_MM, Flat, flatten
from camgen.readers.dxf_layers import NOT_ASKED, layers_of
from camgen.readers.pieces import tally
from camgen.settings import Input, Job
from camgen.shapes import Contour, Note, Part
from camgen.text import harmless, short

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_DEFAULTS = Job()
#: So many curves out of the plane are named one by one, the rest is counted.
_NAMED = 5
#: Layers that every document has, whether the file names them or not.
_ALWAYS = {"0", "defpoints"}


class LayerFacts(Struct, frozen=True):
    """A layer: name, state ("used", or why not) and how many entities of each kind it has, blocks expanded."""

    name: str
    state: str
    counts: tuple[tuple[str, int], ...]


class Facts(Struct, frozen=True):
    """What is in a DXF file; its ``str`` is a page to print.

    closed and open: contours after joining; size: mm; notes as of ``read``.
    """

    version: str
    units: str
    layers: tuple[LayerFacts, ...]
    counts: tuple[tuple[str, int], ...]
    closed: int
    open: int
    size: tuple[float, float]
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        width, height = (short(v, 3) for v in self.size)
        lines = [
            f"DXF {self.version}, units {self.units}, used part {width} x {height} mm",
            f"entities: {_listed(self.counts)}",
            f"contours: {self.closed} closed, {self.open} open",
            *(f"layer {layer.name}: {layer.state}; {_listed(layer.counts)}" for layer in self.layers),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Read(Struct, frozen=True):
    version: str
    units: str
    drawn: Drawn
    contours: tuple[Contour, ...]
    size: tuple[float, float]
    about_file: tuple[Note, ...]
    left: tuple[Note, ...]

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.about_file + self.left


def read(path: Path, job: Job) -> Part:
    """The drawing at ``path``, read with ``[input]``; ellipses and splines within ``tolerance.chord``.

    ``InputError`` if it cannot be read or holds nothing to machine, ``JobError`` for unknown units or layers.
    """
    return read_bytes(path.name, readable(path), job.input, job.tolerance.chord)


def read_bytes(name: str, data: bytes, settings: Input, chord: float) -> Part:
    """``read`` for the bytes of a file called ``name``."""
    found = _read(name, data, settings, chord)
    if not found.contours:
        damage = [n.what for n in found.about_file if n.kind in {"repaired", "skipped", "warning"}]
        left = "; ".join([*damage, *(f"{n.what}: {n.why}" for n in found.left)])
        raise InputError(name, "nothing to machine", left or "the drawing is empty", "draw curves on a visible layer")
    return Part(Path(name).stem, name, found.units, found.contours, found.notes)


def inspect(path: Path, job: Job = _DEFAULTS) -> Facts:
    """What is in the file at ``path``. ``InputError`` if it cannot be read, ``JobError`` as for ``read``."""
    found = _read(path.name, readable(path), job.input, job.tolerance.chord)
    drawn = found.drawn
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {name: Counter() for name in drawn.layers.names}
    for (kind, layer), count in drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer.casefold(), Counter())[kind] += count
    layers = tuple(
        LayerFacts(harmless(drawn.layers.names[key]), drawn.layers.why_not(drawn.layers.names[key]) or "used", counts)
        for key, counts in ((key, tuple(sorted(by_layer[key].items()))) for key in sorted(by_layer))
        if counts or key not in _ALWAYS
    )
    closed = sum(c.closed for c in found.contours)
    return Facts(
        version=found.version,
        units=found.units,
        layers=layers,
        counts=tuple(sorted(kinds.items())),
        closed=closed,
        open=len(found.contours) - closed,
        size=found.size,
        notes=found.notes,
    )


def _read(name: str, data: bytes, settings: Input, chord: float) -> _Read:
    document, notes = dxf_load.load(name, data)
    version = f"{document.dxfversion} ({document.acad_release})"
    unit, scale, unit_notes = units.resolve(name, settings.units, *_stated(document, data))
    layers = layers_of(document, settings.layers)
    # Damaged files hold infinities; what comes of them is found and told by name.
    with np.errstate(invalid="ignore", over="ignore"):
        drawn = walk(name, document, scale, layers)
        layers.check(name)
        # The document is the largest thing in memory and no longer needed.
        del document
        flat = flatten(drawn, chord)
        contours, join_notes = join.contours(flat.soup, settings.join)
    size = _size(contours)
    doubts = units.doubts(*size, unit) if contours and settings.units.strip().lower() == "auto" else ()
    left = (*_left(drawn), *_not_flat(drawn, flat), *_taken(drawn, flat), *join_notes)
    return _Read(version, unit, drawn, contours, size, (*notes, *unit_notes, *doubts), left)


def _stated(document: Drawing, data: bytes) -> tuple[int, int | None]:
    """$INSUNITS (0: none) and $MEASUREMENT of the header, None if there is none.

    ezdxf fills a header that is missing with defaults (metres), hence the look at the bytes.
    """
    insunits, measurement = (
        int(document.header.get(key, 0)) if key.encode() in data else None for key in ("$INSUNITS", "$MEASUREMENT")
    )
    return insunits or 0, measurement


def _size(contours: tuple[Contour, ...]) -> tuple[float, float]:
    """Width and height over the points of all contours, mm."""
    if not contours:
        return 0.0, 0.0
    points = np.concatenate([c.points for c in contours])
    width, height = np.ptp(points, axis=0).tolist()
    return width, height


def _listed(counts: tuple[tuple[str, int], ...]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts) or "none"


def _counted(counts: Counter[tuple[str, str]]) -> str:
    return tally([kind for kind, _ in counts.elements()], [layer for _, layer in counts])


def _left(drawn: Drawn) -> list[Note]:
    """One note per reason for which entities were not used."""
    notes = []
    for why, counts in drawn.left.items():
        if why == NOT_ASKED:
            notes.append(Note("assumed", f"not used: {_counted(counts)}", why))
        elif why in REPAIRED:
            notes.append(Note("repaired", f"dropped: {_counted(counts)}", why))
        else:
            notes.append(Note("skipped", _counted(counts), why))
    return notes


def _not_flat(drawn: Drawn, flat: Flat) -> list[Note]:
    """Notes on curves that leave the plane, by name, and on those whose numbers make no curve."""
    notes = []
    if flat.damaged:
        what = tally([drawn.kind[i] for i in flat.damaged], [drawn.layer[i] for i in flat.damaged])
        notes.append(Note("skipped", what, "damaged numbers"))
    if flat.tilted:
        named = [
            f"{drawn.kind[i]} #{harmless(drawn.handle[i])} on layer {harmless(drawn.layer[i])} leaves the plane by "
            f"{short(height, 3)} mm"
            for i, height in sorted(flat.tilted.items())[:_NAMED]
        ]
        more = len(flat.tilted) - len(named)
        what = "; ".join(named) + (f"; and {more} more" if more else "")
        notes.append(Note("skipped", what, "curves must be flat and parallel to the XY plane; nothing is projected"))
    return notes


def _taken(drawn: Drawn, flat: Flat) -> list[Note]:
    """Notes on what was taken for something simpler: heights, thickness, widths."""
    notes = []
    heights = flat.heights[np.isfinite(flat.heights)]
    low, high = float(heights.min(initial=0.0)), float(heights.max(initial=0.0))
    if max(-low, high) > FLAT_MM:
        low, high = float(heights.min()), float(heights.max())
        at = short(low, 3) if high - low <= FLAT_MM else f"{short(low, 3)} to {short(high, 3)}"
        notes.append(Note("assumed", f"curves drawn at z = {at} mm", "taken as lying in the work plane"))
    if drawn.flattened:
        notes.append(Note("assumed", f"with thickness: {_counted(drawn.flattened)}", "the curve itself is used"))
    if drawn.widths:
        notes.append(Note("assumed", f"with width: {_counted(drawn.widths)}", "the centre line is used"))
    return notes
