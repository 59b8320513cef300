"""Pictures of a flat part: the part's contours in the work plane, from a photo, a scan or a rendering (docs/pist.md).

Photo, work plane, to-scale view, mask, outlines to a part of a pixel, lines and arcs: each step is a module of
``camgen.vision``. The way follows the PIST paper, sections 2 and 3.1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.files import Source
from camgen.model.job import CameraTable, ImageTable, Job
from camgen.model.part import Note, Part, Raster
from camgen.model.pose import FloatArray, pose_from_values
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.vision.boards.find import find
from camgen.vision.boards.lens import LEAST_CORNERS, check_focal_length, fit_sheet_lens
from camgen.vision.boards.sheet import RULER, STROKE, Board, Sheet, make_sheet
from camgen.vision.camera.camera import Camera, read_camera
from camgen.vision.error_bound import ErrorBound, compute_error_bound
from camgen.vision.image import Picture, is_of_sensor, read_picture
from camgen.vision.lines_arcs.contours import OutlineFit, make_contours
from camgen.vision.mask.channel import remove_shadows
from camgen.vision.mask.part_mask import Mask, is_cut_out, make_mask
from camgen.vision.outline import Outline, find_outlines
from camgen.vision.plane import Plane, fit_plane, make_plane, map_points
from camgen.vision.side_wall import find_side_wall, list_cameras
from camgen.vision.to_scale import (
    Region,
    ScaledView,
    cut_out,
    make_scaled_view,
    rectify,
    sample_border,
)

#: A ChArUco board by its squares.
_BOARD = re.compile(r"(\d{1,2})x(\d{1,2})")
#: Pictures of more values are looked at coarsely first: so many times coarser, and then around the part with so much of
#: the bench on each side, coarse pixels at least and as a share of the part.
_LARGE, _COARSER, _ROOM_PX, _ROOM_SHARE = 2_000_000, 4, 24, 0.12

#: A close look finds this share of the area that a coarse one found, at least.
_SAME_PART = 0.5
#: The error bound is computed at about this many places of the outlines.
_BOUND_PLACES = 500
#: A part that leaves the hull of the points by no more, mm, is inside: its outline has a width.
_OUTSIDE_MM = 0.5
#: The blur of an unsharp photo, standard deviation, px. Sharp ones have 0.5 to 1.2.
_UNSHARP_PX = 2.0
#: Operations on patterns, in which small pieces are meant as much as large ones.
_OF_PATTERNS = ("trace", "fill", "drill")
#: A side wall is that of the given height if its own differs by no more than this share.
_SAME_HEIGHT = 0.35
#: A lens that may move a part by more than this, mm, is a warning.
_LENS_MM = 0.1
#: A part beside a sheet or a board whose corners were examined for their lens is refused if it may
#: be further off, mm.
_EXAMINED_MM = 0.5


class PictureFacts(Struct, frozen=True):
    """What is in a picture; its ``str`` is a page to print. part: why none is found, where none is."""

    size: tuple[int, int]
    colour: bool
    scale: str
    part: str
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        width, height = self.size
        lines = [
            f"picture of {width} x {height} px, {'colour' if self.colour else 'grey'}",
            f"scale: {self.scale}",
            f"part: {self.part}",
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Seen(Struct, frozen=True):
    """The way from the picture to the mask."""

    picture: Picture
    camera: Camera | None
    plane: Plane | None
    view: ScaledView
    mask: Mask


def read(source: Source, job: Job, files: Files) -> Part:
    """The part in a picture.

    Raises InputError for a picture that shows none, JobError for settings that contradict another.
    """
    outlined, borders = _outline(source, job, files)
    assert outlined.raster is not None
    drawn, fits, more = make_contours(borders, outlined.raster.work_from_view)
    return replace(outlined, contours=drawn, notes=(*outlined.notes, *more, *_tell_fit(fits)))


def read_outlines(source: Source, job: Job, files: Files) -> Part:
    """The picture with the borders of its part and of loose things, and without contours.

    Borders without an edge have a warning. Raises the other errors of ``read``.
    """
    accept = [*job.image.accept, "specks", "edges"]
    return _outline(source, replace(job, image=replace(job.image, accept=accept)), files)[0]


def _outline(source: Source, job: Job, files: Files) -> tuple[Part, Sequence[Outline]]:
    """The part without contours, and the borders from which they are made."""
    seen = _see(source, job, files)
    borders, notes = find_outlines(seen.mask.grey, seen.mask.pixels)
    _insist_on_edges(source.name, borders, job)
    points = tuple(border.points for border in borders)
    blur = float(np.median([border.blur for border in borders])) if borders else 0.0
    raster = Raster(
        photo=seen.picture.pixels,
        framed=_frame(seen),
        view=seen.view.pixels,
        work_from_view=seen.view.work_from_view,
        mask=seen.mask.pixels,
        borders=points,
        doubt=seen.mask.doubt,
        blur=blur,
    )
    found = (
        *_note_height(job.camera),
        *_note_wall(seen, points, job),
        *_notes(seen),
        *_placed(seen, points, job),
        *_note_blur(blur),
        *notes,
    )
    return Part(source.stem, source.name, _scale(seen.view), (), found, raster), borders


def _insist_on_edges(name: str, borders: Sequence[Outline], job: Job) -> None:
    """Raises NoSafeProgram if an outline has no edge in the picture, or all are of shadows alone.

    The job may accept such outlines.
    """
    if "edges" in job.image.accept:
        return
    if borders and all(outline.is_shadow for outline in borders):
        what = "shows a shadow alone: all outlines are sharp on one side and soft on the other, "
        what += "and as wide everywhere; part and bench hardly differ"
        remedy = (
            "put the part on a bench of another tone, light it from all sides, give "
            'image.background, or set image.accept = ["edges"]'
        )
        raise NoSafeProgram(name, what, remedy=remedy)
    count = sum(not outline.has_edge for outline in borders)
    if count:
        what = f"shows no edge along {count} of {counted(len(borders), 'outline')} of the part"
        remedy = (
            "light the part evenly, choose another image.mask, give image.background, or set "
            'image.accept = ["edges"]'
        )
        raise NoSafeProgram(name, what, remedy=remedy)


def _note_blur(blur: float) -> tuple[Note, ...]:
    """The warning on an unsharp photo. blur: standard deviation, px."""
    if blur < _UNSHARP_PX:
        return ()
    what = f"the photo is unsharp: its edges have a blur of {blur:.1f} px"
    return (Note("warning", what, "corners come out round; focus, hold still, or come nearer"),)


def _tell_fit(fits: Sequence[OutlineFit]) -> tuple[Note, ...]:
    """How well the lines and arcs follow what was measured."""
    if not fits:
        return ()
    lines, arcs = sum(fit.lines for fit in fits), sum(fit.arcs for fit in fits)
    rms, most = max(fit.rms_mm for fit in fits), max(fit.max_mm for fit in fits)
    what = f"{counted(lines, 'line')} and {counted(arcs, 'arc')} found in the outlines"
    return (
        Note(
            "assumed",
            what,
            f"they leave the measured edge by {most:.3f} mm at most, {rms:.3f} mm rms",
        ),
    )


def inspect(source: Source, job: Job, files: Files) -> PictureFacts:
    """What is in the picture ``source``, as far as its scale is known."""
    picture = read_picture(source)
    height, width = picture.pixels.shape[:2]
    colour = picture.pixels.ndim == 3
    try:
        part = read(source, job, files)
    except (InputError, JobError, NoSafeProgram) as error:
        known = f"{short(25.4 / picture.dpi, 5)} mm/px from its DPI" if picture.dpi else "not known"
        return PictureFacts((width, height), colour, known, str(error), picture.notes)
    pieces = sum(len(c.points) for c in part.contours)
    holes = f"{counted(len(part.contours), 'contour')}, {counted(pieces, 'line or arc', 'lines and arcs')}"
    low = np.min([c.points.min(axis=0) for c in part.contours], axis=0)
    high = np.max([c.points.max(axis=0) for c in part.contours], axis=0)
    size = " x ".join(short(v, 2) for v in (high - low).tolist())
    return PictureFacts((width, height), colour, part.units, f"{size} mm, {holes}", part.notes)


def _see(source: Source, job: Job, files: Files) -> _Seen:
    _nothing_unused(job)
    picture = _light(read_picture(source, sensor=is_of_sensor(job.camera)), job)
    camera = read_camera(files.read(job.camera.file)) if job.camera.file else None
    plane = _plane(picture, camera, job.camera)
    # The view is made with the camera that the sheet shows; that one is not calibrated.
    used = plane.lens.camera if plane is not None and plane.lens is not None else camera
    way = _Way(used, plane, job, _by_alpha(picture, job.image))
    empty = _second(picture, job, files, "background") if job.image.background else None
    if job.image.lamp_moved:
        other = _second(picture, job, files, "lamp_moved")
        lit = remove_shadows(picture.pixels, other.pixels, other.name)
        picture = replace(picture, pixels=lit)
    region, coarse = _region(job, way.plane), False
    if region is None and picture.pixels.size > _LARGE:
        region, area = _around(way, picture, empty)
        coarse = region is not None
    view, mask = _mask(way, picture, empty, region, 1)
    if coarse:
        _check_area(picture.name, area, _area(view, mask))
    if region is not None and job.image.region is None:
        view = replace(view, notes=(*view.notes, _note_surroundings(region, coarse)))
    return _Seen(picture, camera, way.plane, view, mask)


def _second(picture: Picture, job: Job, files: Files, key: str) -> Picture:
    """The photo of the key ``background`` or ``lamp_moved``, taken from the same place.

    Raises InputError if its size or its colours differ.
    """
    file = files.read(getattr(job.image, key))
    second = _light(read_picture(file, sensor=is_of_sensor(job.camera)), job)
    if second.pixels.shape == picture.pixels.shape:
        return second
    differ = "size" if second.pixels.shape[:2] != picture.pixels.shape[:2] else "colors"
    what = f"differs in {differ} from the photo of the part"
    remedy = "take both with the same camera and settings from the same place"
    raise InputError(second.name, what, f"[image] {key}", remedy)


def _nothing_unused(job: Job) -> None:
    """JobError for a setting that the others leave without effect: the user believes that it has one."""
    image, camera = job.image, job.camera
    measured = camera.points_px is not None or bool(camera.markers)
    plane = measured or camera.plane_from is not None
    paper = bool(camera.markers) and not _BOARD.fullmatch(camera.markers)
    for where, unused, why in (
        (
            "[image] mm_per_px",
            plane and image.mm_per_px is not None,
            "the work plane gives the scale",
        ),
        (
            "[image] width_mm",
            plane and image.width_mm is not None,
            "the work plane gives the scale",
        ),
        ("[camera] height", bool(camera.height) and not measured, "it is for points and markers"),
        (
            "[camera] printed_length",
            camera.printed_length != RULER and not paper,
            "no sheet is used",
        ),
        (
            "[image] background",
            bool(image.background) and image.mask not in ("auto", "background"),
            f'mask = "{image.mask}" does not look at it',
        ),
        (
            "[image] threshold",
            image.mask == "alpha" and image.threshold is not None,
            'mask = "alpha" takes what is half opaque',
        ),
        (
            "[image] color",
            image.mask == "alpha" and image.color is not None,
            'mask = "alpha" does not look at it',
        ),
        ("[image] lines", image.lines != "auto", "it is for drawings that are traced"),
    ):
        if unused:
            raise JobError(where, f"has no effect: {why}", remedy="leave one of the two out")


def _note_surroundings(region: Region, coarse: bool) -> Note:
    """What was taken for the surroundings of the part: whatever lies outside is not in the program."""
    shown = ", ".join(short(v, 2) for v in region)
    why = (
        f"a look {_COARSER} times coarser found the part there"
        if coarse
        else "the free area of the marker sheet, less with the height of the part"
    )
    return Note(
        "assumed", f"looked at closely: [{shown}] mm only", f"{why}; set image.region for another"
    )


def _light(picture: Picture, job: Job) -> Picture:
    """The picture with values that are light: blur of lens and sensor acts on light, and so does the level of an edge.

    IEC 61966-2-1 has the curve.
    """
    if job.image.tones == "linear":
        return picture
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    coded = np.arange(256) / 255
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    pixels = cv2.LUT(picture.pixels, (light * 255).round().astype(np.uint8))
    return replace(picture, pixels=np.asarray(pixels, dtype=np.uint8))


class _Way(Struct, frozen=True):
    """How a picture becomes a view."""

    camera: Camera | None
    plane: Plane | None
    job: Job
    by_alpha: bool


def _by_alpha(picture: Picture, table: ImageTable) -> bool:
    """Whether the transparency of the picture is the mask.

    Raises JobError if the job asks for it and the picture is opaque.
    """
    if table.mask == "alpha":
        if picture.alpha is None:
            what = f'"alpha" needs transparency, {picture.name} is opaque everywhere'
            raise JobError("[image] mask", what, remedy="save it with its transparency")
        return True
    others = table.background or table.threshold is not None or table.color is not None
    if table.mask != "auto" or others or table.invert or picture.alpha is None:
        return False
    return is_cut_out(picture.alpha)


def _mask(
    way: _Way, picture: Picture, empty: Picture | None, region: Region | None, coarser: int
) -> tuple[ScaledView, Mask]:
    view = _view(way, picture, region, coarser)
    if way.by_alpha and picture.alpha is not None:
        opaque = _view(way, replace(picture, pixels=picture.alpha), region, coarser)
        return view, make_mask(opaque, replace(way.job.image, mask="alpha"), None, picture.name)
    background = None if empty is None else _view(way, empty, region, coarser)
    table = way.job.image
    kinds = {way.job.operation.kind, *(step.operation.kind for step in way.job.operations)}
    if not kinds.isdisjoint(_OF_PATTERNS):
        table = replace(table, accept=[*table.accept, "specks"])
    return view, make_mask(view, table, background, picture.name)


def _area(view: ScaledView, mask: Mask) -> float:
    """The area of a part, mm2."""
    return float(np.count_nonzero(mask.pixels)) * view.mm_per_px**2


def _check_area(name: str, coarse: float, close: float) -> None:
    """Raises NoSafeProgram if a coarse and a close look find parts of much different areas, mm2."""
    if close < _SAME_PART * coarse:
        what = f"a coarse look finds a part of {coarse:.0f} mm2, a close one finds {close:.0f} mm2"
        remedy = "part and bench hardly differ: light it evenly, or choose another image.mask"
        raise NoSafeProgram(name, what, remedy=remedy)


def _around(way: _Way, picture: Picture, empty: Picture | None) -> tuple[Region | None, float]:
    """The part with some bench around it, mm, as a coarse view shows it, and its area, mm2.

    The rest of the photo is not examined further.
    """
    try:
        view, mask = _mask(way, picture, empty, None, _COARSER)
    except InputError:
        return None, 0.0  # the close look finds it, or says why not
    columns, rows = np.flatnonzero(mask.pixels.any(axis=0)), np.flatnonzero(mask.pixels.any(axis=1))
    height, width = mask.pixels.shape
    room = max(_ROOM_PX, round(_ROOM_SHARE * max(np.ptp(columns), np.ptp(rows))))
    left, right = max(columns[0] - room, 0), min(columns[-1] + room, width - 1)
    top, bottom = max(rows[0] - room, 0), min(rows[-1] + room, height - 1)
    corners = view.work_from_view @ np.array([[left, right], [bottom, top], [1.0, 1.0]])
    x0, y0, x1, y1 = corners.T.ravel().tolist()
    return (x0, y0, x1, y1), _area(view, mask)


def _plane(picture: Picture, camera: Camera | None, table: CameraTable) -> Plane | None:
    """The work plane, by the one way that is given; none for a picture that is to scale."""
    ways = {
        "points_px": table.points_px is not None or table.points_mm is not None,
        "plane_from": table.plane_from is not None,
        "markers": bool(table.markers),
    }
    given = [name for name, is_given in ways.items() if is_given]
    if len(given) > 1:
        raise JobError(
            "[camera]", f"{' and '.join(given)} are both given", remedy="give one of them"
        )
    if ways["points_px"]:
        if table.points_px is None or table.points_mm is None:
            raise JobError(
                "[camera]",
                "points_px and points_mm belong together",
                remedy="give both, in one order",
            )
        pairs = fit_plane(camera, table.points_px, table.points_mm)
        if not table.height:
            return pairs
        height, width = picture.pixels.shape[:2]
        lens = None
        if camera is None:
            px, mm, size = pairs.pairs_px, pairs.pairs_mm, (width, height)
            lens = fit_sheet_lens(px, mm, size, needs_focal=True, focal_px=picture.focal_px)
            check_focal_length(lens)
        used = camera if lens is None else lens.camera
        plane = fit_plane(used, table.points_px, table.points_mm, height=table.height)
        return plane if lens is None else replace(plane, lens=lens, notes=(lens.note, *plane.notes))
    if table.plane_from is not None:
        if camera is None:
            raise JobError(
                "[camera] plane_from", "a pose needs the camera", remedy="give [camera] file"
            )
        if len(table.plane_from) != 6:
            raise JobError(
                "[camera] plane_from",
                f"has {counted(len(table.plane_from), 'value')}",
                remedy="give 6",
            )
        return make_plane(camera, pose_from_values(table.plane_from))
    if table.markers:
        return find(picture, camera, find_target(table), height=table.height)
    return None


def _view(way: _Way, picture: Picture, region: Region | None, coarser: int) -> ScaledView:
    if way.plane is not None:
        return rectify(picture, way.camera, way.plane, region, coarser)
    if way.camera is not None:
        remedy = "give [camera] points_px and points_mm, plane_from, or markers"
        raise JobError("[camera]", "a lens without a work plane", remedy=remedy)
    table = way.job.image
    return cut_out(make_scaled_view(picture, table.mm_per_px, table.width_mm), region, coarser)


def _region(job: Job, plane: Plane | None) -> Region | None:
    """What is looked at: what the job says; on a marker sheet its free area, since markers look like parts."""
    values = job.image.region
    if values is None:
        target = find_target(job.camera) if job.camera.markers else None
        if isinstance(target, Board):
            remedy = "give [image] region = [x from, y from, x to, y to], mm from the board's lower left corner"
            raise JobError(
                "[camera] markers", "a board on the bench looks like a part", remedy=remedy
            )
        return None if target is None or plane is None else _free_area(target, plane)
    if len(values) != 4:
        raise JobError(
            "[image] region",
            f"has {counted(len(values), 'value')}",
            remedy="give [x from, y from, x to, y to], mm",
        )
    x0, y0, x1, y1 = values
    return x0, y0, x1, y1


def _free_area(paper: Sheet, plane: Plane) -> Region:
    """The free area of a sheet as it is seen in the work plane, mm.

    Above the sheet, the lines of sight from the area to the camera enclose a smaller rectangle. It
    is moved towards the point below the camera. The marks of the origin touch the area, and stay
    outside by their width.
    """
    corners = map_points(plane.work_from_pairs, np.array([(0.0, 0.0), paper.free]))
    room = STROKE if np.any(plane.work_from_pairs != np.eye(3)) else 0.0
    (x0, y0), (x1, y1) = corners[0] + room, corners[1] - room
    if x0 >= x1 or y0 >= y1:
        what = f"at this height nothing of the free area of the {paper.label} is left"
        raise JobError("[camera] height", what, remedy="take the photo from higher up")
    return float(x0), float(y0), float(x1), float(y1)


def find_target(table: CameraTable) -> Sheet | Board:
    """The sheet or the board that lies on the bench."""
    squares = _BOARD.fullmatch(table.markers)
    if squares is None:
        return make_sheet(table.markers, table.marker, table.printed_length)
    return Board(int(squares[1]), int(squares[2]), table.square, table.marker)


def _frame(seen: _Seen) -> FloatArray:
    """The border of the view in the photo, (N, 2) px."""
    height, width = seen.picture.pixels.shape[:2]
    if seen.plane is None:
        return np.array(
            [[0.0, 0.0], [width - 1.0, 0.0], [width - 1.0, height - 1.0], [0.0, height - 1.0]]
        )
    return sample_border(seen.view, seen.camera, seen.plane, (width, height))


def _placed(seen: _Seen, outlines_px: Sequence[FloatArray], job: Job) -> tuple[Note, ...]:
    """The error bound of the outlines, as notes.

    Raises NoSafeProgram if a lens that is not calibrated may move them too far. The corners of a
    sheet or a board are examined for their lens; points are too few for that.
    """
    plane = seen.plane
    if plane is None or not len(plane.pairs_px) or not outlines_px:
        return ()
    matrix = seen.view.work_from_view
    outline = np.concatenate(outlines_px) @ matrix[:, :2].T + matrix[:, 2]
    height, width = seen.picture.pixels.shape[:2]
    step = max(1, len(outline) // _BOUND_PLACES)
    bound = compute_error_bound(plane, seen.camera, (width, height), outline[::step])
    off = f"up to {short(bound.outside, 1)} mm outside of the points that gave the work plane"
    is_calibrated = seen.camera is not None and plane.lens is None
    is_beside = not is_calibrated and bound.outside > _OUTSIDE_MM
    is_examined = bool(job.camera.markers) and len(plane.pairs_px) >= LEAST_CORNERS
    limit = _EXAMINED_MM if is_examined else job.tolerance.chord
    by_lens = bound.noise + bound.lens
    if is_beside and bound.known and by_lens > limit and "outside" not in job.image.accept:
        what = f"the part lies {off}, without a calibrated lens: it may be {_mm(bound.total)} off"
        remedy = (
            "give camera.file (camgen calibrate), lay the sheet or board around the part, or set "
            'image.accept = ["outside"]'
        )
        raise NoSafeProgram(seen.picture.name, what, remedy=remedy)
    notes = [_note_bound(bound, is_calibrated)] if bound.known else []
    if is_beside and not (is_examined and by_lens <= _LENS_MM):
        what = f"the part lies {off}, without a calibrated lens"
        how = _mm(bound.total) if bound.known else "unknown, there are too few points"
        why = (
            f"how far off it may be: {how}; give camera.file, or lay sheet or board around the part"
        )
        notes.append(Note("warning", what, why, strict="outside" not in job.image.accept))
    elif bound.lens > _LENS_MM:
        what = f"no camera.file is given, and a lens may move the part by {_mm(bound.lens)}"
        notes.append(Note("warning", what, "the points do not lie as without a lens"))
    if bound.height > _LENS_MM:
        what = f"the height may move the part by {_mm(bound.height)}"
        why = "the focal length is from the photo: tilt the camera more, or give camera.file"
        notes.append(Note("warning", what, why, strict=True))
    return tuple(notes)


def _note_bound(bound: ErrorBound, is_calibrated: bool) -> Note:
    lens = "the lens as calibrated" if is_calibrated else f"{_mm(bound.lens)} by the lens"
    if bound.height:
        lens += f", {_mm(bound.height)} by the height and the focal length"
    outside = "inside of the points"
    if bound.outside > _OUTSIDE_MM:
        outside = f"up to {short(bound.outside, 1)} mm outside of the points"
    why = f"{_mm(bound.noise)} by the noise of the points, {lens}; the part lies {outside}"
    return Note("assumed", f"the part is placed to within {_mm(bound.total)}", why)


def _mm(value: float) -> str:
    return f"{max(value, 0.001):.3f} mm"


def _note_height(table: CameraTable) -> tuple[Note, ...]:
    """A part of some thickness on markers comes out too large, and beside its place."""
    if table.height or not (table.markers or table.points_px):
        return ()
    where = "sheet" if table.markers else "points"
    if _BOARD.fullmatch(table.markers):
        where = "board"
    what = f"height 0: the part's upper face lies in the plane of the {where}"
    calibration = "" if table.markers else ", with camera.file,"
    return (Note("assumed", what, f"camera.height{calibration} says how far above it"),)


def _note_wall(seen: _Seen, borders: Sequence[FloatArray], job: Job) -> tuple[Note, ...]:
    """A warning of a side wall in the picture.

    Without a height, the outline is shifted. With one, it is wrong where it runs along the foot.
    """
    if seen.plane is None or not job.camera.markers or not borders:
        return ()
    cameras = list_cameras(seen.picture, seen.plane, seen.camera)
    matrix = seen.view.work_from_view
    pixels = seen.view.pixels, seen.mask.pixels
    wall = find_side_wall(*pixels, matrix, borders, seen.plane, cameras)
    if wall is None:
        return ()
    given = job.camera.height
    if given:
        if not wall.is_part or abs(wall.highest - given) > _SAME_HEIGHT * given:
            return ()
        what = f"the outline runs along the foot of a side wall, up to {_mm(wall.width)} off"
        why = "give image.threshold between the tones of wall and upper face, or light the walls"
        return (Note("warning", what, why, strict=True),)
    height = f"about {short(wall.highest, 1)} mm"
    if wall.lowest < wall.highest:
        height = f"{short(wall.lowest, 1)} to {short(wall.highest, 1)} mm"
    what = f"a side wall of the part is in the picture, {height} high"
    why = f"that moves the outline by up to {short(wall.shift, 1)} mm: give camera.height"
    return (Note("warning", what, why, strict=True),)


def _scale(view: ScaledView) -> str:
    return f"{short(view.mm_per_px, 5)} mm/px"


def _notes(seen: _Seen) -> tuple[Note, ...]:
    plane = seen.plane
    measured: tuple[Note, ...] = ()
    if plane is not None and len(plane.residuals_mm):
        what = f"work plane from {len(plane.residuals_mm)} points, rms {short(plane.rms_mm, 4)} mm"
        measured = (Note("assumed", f"{what}, largest {short(plane.max_mm, 4)} mm"),)
    mask = Note("assumed", f"part by {seen.mask.method}", seen.mask.why)
    return (
        *seen.picture.notes,
        *(plane.notes if plane is not None else ()),
        *measured,
        *seen.view.notes,
        mask,
        *seen.mask.notes,
    )
