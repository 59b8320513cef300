"""The command `localize`: finds a CAD part in a point cloud and writes its work frame."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Row, Terminal, join_rows, label_rows, rows_of_notes
from camgen.localize import SOME_RUN_ON, Location, localize
from camgen.localize.advice import ModelPart, localize_or_advise
from camgen.localize.doubt import Rival
from camgen.localize.scans import Scan, open_scan, read_scan
from camgen.localize.words import describe_patch, format_values
from camgen.model.errors import JobError
from camgen.model.files import Source
from camgen.model.limits import Limits
from camgen.model.part import Note
from camgen.model.pose import FloatArray, Pose, pose_from_values
from camgen.model.text import counted, harmless, short, short_each
from camgen.model.version import __version__
from camgen.read.files import Files
from camgen.read.solid import STEP, mesh, step
from camgen.read.units import MM

#: Meshes that state their unit.
_STATED = (".3mf", ".glb")
#: Poses that fit as well are listed up to this number.
_LISTED = 6
#: As ``--viewpoint``: the scanner stood at several places, or where the file does not say.
_UNKNOWN = "unknown"


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Write and print the frame, and report its evidence and other poses that fit as well."""
    model, scan, target = Path(arguments.model), Path(arguments.scan), Path(arguments.output)
    unit, start = _unit("--units", arguments.units), _start(arguments.start)
    model_unit = _unit("--model-units", arguments.model_units)
    viewpoint = _viewpoint(arguments.viewpoint)
    check_targets([target], [model, scan])
    terminal.stage(f"reading {model.name}")
    files = Files()
    source = files.read(model)
    part = _part(source, model_unit)
    terminal.stage(f"reading {scan.name}")
    seen = read_scan(open_scan(scan, files), unit)

    def search(part: ModelPart, scan_in_mm: Scan) -> Location:
        eye = scan_in_mm.viewpoint if arguments.viewpoint is None else viewpoint
        triangles = (part.vertices, part.faces)
        return localize(scan.name, triangles, scan_in_mm.points, start, terminal.stage, eye)

    location = localize_or_advise(search, part, seen, lambda unit: _part(source, unit))
    names, units = (model.name, scan.name), (part.unit, seen.unit)
    if arguments.viewpoint is None:
        stood = _describe_place(seen.viewpoint, ", as the scan says")
    else:
        stood = _describe_place(viewpoint, "")
    write_all([(target, job(names, units, location, stood).encode())], files.opened)
    if not terminal.quiet:
        terminal.out(_line(location.base_from_work) + "\n")
    size = " x ".join(short_each(np.ptp(part.vertices, axis=0).tolist(), 3))
    model_text = f"{model.name}: {size} mm, {counted(len(part.faces), 'triangle')}"
    scan_text = f"{scan.name}: {counted(len(seen.points), 'point')}"
    notes = [*part.notes, *seen.notes, *_note_drawn(seen, location), *_note_far(location)]
    terminal.rows(
        [
            ("model", f"{model_text}, {_describe_unit(part.unit)}", "plain"),
            ("scan", f"{scan_text}, {_describe_unit(seen.unit)}", "plain"),
            *rows_of_notes(notes),
            *_describe(location, stood),
            ("written", str(target), "good"),
        ]
    )


def _note_far(location: Location) -> list[Note]:
    """A warning about a frame that is too far from the origin for a build."""
    farthest, limit = max(map(abs, location.base_from_work.origin)), Limits().number
    if farthest <= limit:
        return []
    what = f"the part stands {short(farthest / 1e6, 1)} km from the origin of the scan"
    why = f"builds take frames up to {limit:g} mm: move the scan near its origin"
    return [Note("warning", what, why)]


def _describe_place(place: FloatArray | None, source: str) -> str:
    return "" if place is None else f"{', '.join(short_each(place.tolist(), 2))} mm{source}"


def _describe_unit(unit: str) -> str:
    return f"1 unit = {MM[unit]:.10g} mm"


def _note_drawn(scan: Scan, location: Location) -> list[Note]:
    """A note on the points of a large scan that were not used."""
    if location.points == len(scan.points):
        return []
    what = f"{counted(location.points, 'point')} of {counted(len(scan.points), 'point')} were used"
    return [Note("assumed", what, "drawn with a fixed seed")]


def _unit(option: str, name: str | None) -> str:
    """The unit of an option; "" without it."""
    if name is None:
        return ""
    unit = name.strip().lower()
    if unit not in MM:
        raise JobError(
            option, f"unknown unit {harmless(name)!r}", remedy="give mm, cm, m, inch, ..."
        )
    return unit


def _start(text: str | None) -> Pose | None:
    if text is None:
        return None
    values = _read_numbers(text)
    if len(values) != 6:
        raise JobError(
            "--start", f"{text!r} is not a pose", remedy="give x,y,z,rx,ry,rz in mm and deg"
        )
    return pose_from_values(values)


def _read_numbers(text: str) -> list[float]:
    """Finite numbers between commas; nothing for any other text."""
    try:
        values = list(map(float, text.split(",")))
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _viewpoint(text: str | None) -> FloatArray | None:
    """The position of the scanner, None if it is not given or not known."""
    if text is None or text.strip().lower() == _UNKNOWN:
        return None
    values = _read_numbers(text)
    if len(values) != 3:
        raise JobError(
            "--viewpoint",
            f"{text!r} is not a position",
            remedy=f"give x,y,z in mm, or {_UNKNOWN} to ignore the viewpoint of the scan",
        )
    return np.array(values)


def _part(source: Source, unit: str) -> ModelPart:
    """The model. Notes on its edges are left out: they do not matter here.

    unit: the unit of a mesh that states none; "" for mm.

    Raises JobError if the file states another unit.
    """
    if source.suffix in STEP:
        solid = step.read(source)
        notes = [note for note in solid.notes if note.kind == "assumed"]
        in_file = solid.units if solid.units in MM else "mm"
        part = ModelPart(solid.vertices, solid.faces, notes, in_file, True)
    else:
        stated = source.suffix in _STATED
        surface, all_notes = mesh.read_surface(source, MM[unit] if unit and not stated else None)
        notes = [note for note in all_notes if note.kind == "repaired"]
        in_file = surface.units if stated else unit or "mm"
        part = ModelPart(surface.vertices, surface.faces, notes, in_file, stated)
    if unit and MM[unit] != MM[part.unit]:
        raise JobError(
            "--model-units",
            f"says {unit}, and {source.name} states its unit: {part.unit}",
            "",
            "leave it out",
        )
    return part


def job(names: tuple[str, str], units: tuple[str, str], location: Location, stood: str) -> str:
    """The job file: the work frame, and as comments the units, overlap and other evidence.

    names: the file names of the model and of the scan.
    units: the units of the model and of the scan.
    stood: the place of the scanner; "" if it is not known.
    """
    lines = [
        f"camgen {__version__}: where {harmless(names[0])} stands in {harmless(names[1])}",
        f"units: {_describe_unit(units[0])} in the model, {_describe_unit(units[1])} in the scan",
        *join_rows(_describe(location, stood)),
    ]
    comments = "".join(f"# {line}\n" for line in lines)
    return f"{comments}\n[cell]\n{_line(location.base_from_work)}\n"


def _line(pose: Pose) -> str:
    return f"base_from_work = {format_values(pose)}"


def _describe(location: Location, stood: str) -> list[Row]:
    """The rows of the summary on a location, which are comments of the job file too."""
    near = _percent(location.seen.near)
    points = counted(location.used, "point that counts", "points that count")
    rows: list[Row] = [("viewpoint", stood, "plain")] if stood else []
    rows += _list_left_out(location)
    rest = " without the bench" if location.bench else ""
    overlap = f"{_percent(location.overlap)} of the scan{rest}"
    seen = f"{_percent(location.seen.all)} of the model's surface"
    rows += [
        ("overlap", f"{overlap} lie within {short(location.within, 3)} mm of the model", "plain"),
        ("seen", f"{seen}, {near} of the side that faces the scanner", "plain"),
        ("residual", f"{location.rms:.4f} mm rms of the {points}", "plain"),
    ]
    if location.free:
        rows.append(
            ("ambiguous", f"{location.free} changes nothing: the scan does not hold that", "look")
        )
    elif location.rivals:
        rows.append(("ambiguous", f"other poses that fit as well: {len(location.rivals)}", "look"))
        for rival in location.rivals[:_LISTED]:
            rows.append(("", _describe_rival(rival, location.noise_limit), "look"))
        if len(location.rivals) > _LISTED:
            rows.append(("", f"and {len(location.rivals) - _LISTED} more", "look"))
    elif location.next_best is not None:
        other = location.next_best
        pose = f"turned by {other.turn:.1f} deg, moved by {short(other.shift, 1)} mm"
        rows.append(("next best", f"a pose {pose} fits worse", "plain"))
    if location.run_on > SOME_RUN_ON:
        beyond = f"the scan runs on beyond {_percent(location.run_on)} of the rims"
        rows.append(("flush", f"{beyond}: it stands where --start says", "look"))
    accepted = [f"{describe_patch(p)}: accepted, since --start is near" for p in location.patches]
    repeats = [f"the scan shows the part once more: {_line(pose)}" for pose in location.again]
    rows += [*label_rows("start", accepted, "look"), *label_rows("again", repeats, "look")]
    if location.weak:
        rows.append(
            ("weak", f"few points hold {location.weak}: scan the part from more sides", "look")
        )
    return rows


def _list_left_out(location: Location) -> list[tuple[str, str, str]]:
    """Rows on the points that took no part in the search."""
    rows = []
    if location.bench:
        points = counted(location.bench, "point lies", "points lie")
        rows.append(
            ("bench", f"{points} in the plane under the part, or below it: left out", "plain")
        )
    if location.isolated:
        points = counted(location.isolated, "point is", "points are")
        rows.append(("strays", f"{points} far from all others: left out", "plain"))
    return rows


def _describe_rival(rival: Rival, noise_limit: float) -> str:
    turned = f"turned by {rival.turn:.1f} deg"
    if rival.distance > noise_limit:
        turned += f", surface up to {short(rival.distance, 2)} mm elsewhere"
    return f"{turned}: {_line(rival.base_from_work)}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
