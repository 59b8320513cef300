"""Reads the contours of a flat part from a photo, a scan or a rendering (docs/pist.md).

The steps are the photo, the work plane, the rectified view, the mask, outlines at sub-pixel edges,
and lines and arcs. Each one is a module of `camgen.vision`. The method is that of PIST, sections 2
and 3.1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import compress

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
from camgen.read.units import format_size
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

#: Name of a ChArUco board, by its squares.
_BOARD = re.compile(r"(\d{1,2})x(\d{1,2})")
#: Values of a picture above which the part is located in a coarse view first. The fine view then
#: shows the part and its surroundings only.
_LARGE = 2_000_000
#: Factor on the pixel size in the coarse view.
_COARSER = 4
#: Width of the surroundings on each side, in coarse pixels at least,
_MIN_MARGIN_PX = 24
#: and as a fraction of the size of the part.
_MARGIN_FRACTION = 0.12
#: Smallest area of the part in the fine view, as a fraction of the area in the coarse view.
_SAME_PART = 0.5
#: Number of points of the outlines at which the error bound is computed, about.
_BOUND_POINTS = 500
#: mm: a part counts as inside of the points if it leaves their hull by this at most, because its
#: outline has a width.
_OUTSIDE_MM = 0.5
#: px: standard deviation of the blur from which a photo is unsharp. Sharp photos have 0.5 to 1.2.
_UNSHARP_PX = 2.0
#: Kinds of operations on patterns, of which small pieces matter as much as large ones.
_PATTERN_KINDS = ("trace", "fill", "drill")
#: Largest difference of a side wall from the given height, as a fraction of the height.
_SAME_HEIGHT = 0.35
#: mm: displacement of the part by the lens above which there is a warning.
_LENS_MM = 0.1
#: mm: displacement above which a part next to a sheet or a board is refused, if the corners of the
#: sheet or board were examined for their lens.
_EXAMINED_MM = 0.5


class PictureFacts(Struct, frozen=True):
    """The content of a picture. Its `str` is a page to print.

    size: width and height, px.
    colour: whether it has colours.
    scale: its scale and the source of the scale.
    part: size and contours of the part, or the reason why it is missing.
    notes: notes of `read`, or those of the picture if there is no part.
    """

    size: tuple[int, int]
    colour: bool
    scale: str
    part: str
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        width, height = self.size
        picture = f"picture of {width} x {height} px, {'colour' if self.colour else 'grey'}"
        lines = (picture, f"scale: {self.scale}", f"part: {self.part}", *map(str, self.notes))
        return "\n".join(lines)


class _Segmented(Struct, frozen=True):
    """A picture whose part was found.

    picture: the picture, with values proportional to light.
    camera: the calibrated camera, None without one.
    plane: the work plane, None for a picture that is to scale.
    view: the rectified view.
    mask: the part in the view.
    """

    picture: Picture
    camera: Camera | None
    plane: Plane | None
    view: ScaledView
    mask: Mask


def read(source: Source, job: Job, files: Files) -> Part:
    """The part in a picture.

    Raises InputError for a picture without a part, JobError for settings that contradict each
    other, and NoSafeProgram for outlines that are too uncertain.
    """
    part, borders = _outline(source, job, files)
    assert part.raster is not None
    contours, fits, fit_notes = make_contours(borders, part.raster.work_from_view)
    return replace(part, contours=contours, notes=(*part.notes, *fit_notes, *_note_fit(fits)))


def read_outlines(source: Source, job: Job, files: Files) -> Part:
    """A part without contours whose raster has the outlines of the part and of loose things.

    Outlines without an edge have a warning. Raises the other errors of `read`.
    """
    accept = [*job.image.accept, "specks", "edges"]
    return _outline(source, replace(job, image=replace(job.image, accept=accept)), files)[0]


def _outline(source: Source, job: Job, files: Files) -> tuple[Part, Sequence[Outline]]:
    """The part without contours, and the outlines of which the contours are made."""
    seen = _segment(source, job, files)
    borders, notes = find_outlines(seen.mask.grey, seen.mask.pixels)
    _check_edges(source.name, borders, job)
    points = tuple(border.points for border in borders)
    blur = float(np.median([border.blur for border in borders])) if borders else 0.0
    raster = Raster(
        photo=seen.picture.pixels,
        framed=_find_frame(seen),
        view=seen.view.pixels,
        work_from_view=seen.view.work_from_view,
        mask=seen.mask.pixels,
        borders=points,
        doubt=seen.mask.doubt,
        blur=blur,
    )
    part_notes = (
        *_note_height(job.camera),
        *_note_wall(seen, points, job),
        *_note_steps(seen),
        *_note_placement(seen, points, job),
        *_note_blur(blur),
        *notes,
    )
    scale = f"{short(seen.view.mm_per_px, 5)} mm/px"
    return Part(source.stem, source.name, scale, (), part_notes, raster), borders


def _check_edges(name: str, borders: Sequence[Outline], job: Job) -> None:
    """Raises NoSafeProgram if an outline has no edge in the picture, or all are of shadows alone.

    The job may accept such outlines.
    """
    if "edges" in job.image.accept:
        return
    if borders and all(outline.is_shadow for outline in borders):
        raise NoSafeProgram(
            name,
            "shows a shadow alone: all outlines are sharp on one side and soft on the other, "
            "and as wide everywhere; part and bench hardly differ",
            remedy="put the part on a bench of another tone, light it from all sides, give "
            'image.background, or set image.accept = ["edges"]',
        )
    count = sum(not outline.has_edge for outline in borders)
    if count:
        raise NoSafeProgram(
            name,
            f"shows no edge along {count} of {counted(len(borders), 'outline')} of the part",
            remedy="light the part evenly, choose another image.mask, give image.background, or "
            'set image.accept = ["edges"]',
        )


def _note_blur(blur: float) -> Iterator[Note]:
    """A warning on an unsharp photo. blur: standard deviation, px."""
    if blur >= _UNSHARP_PX:
        yield Note(
            "warning",
            f"the photo is unsharp: its edges have a blur of {blur:.1f} px",
            "corners come out round; focus, hold still, or come nearer",
        )


def _note_fit(fits: Sequence[OutlineFit]) -> Iterator[Note]:
    if fits:
        lines, arcs = sum(fit.lines for fit in fits), sum(fit.arcs for fit in fits)
        rms, largest = max(fit.rms_mm for fit in fits), max(fit.max_mm for fit in fits)
        yield Note(
            "assumed",
            f"{counted(lines, 'line')} and {counted(arcs, 'arc')} found in the outlines",
            f"they leave the measured edge by {largest:.3f} mm at most, {rms:.3f} mm rms",
        )


def inspect(source: Source, job: Job, files: Files) -> PictureFacts:
    """The content of a picture. Raises InputError if it cannot be read."""
    picture = read_picture(source)
    height, width = picture.pixels.shape[:2]
    colour = picture.pixels.ndim == 3
    try:
        part = read(source, job, files)
    except (InputError, JobError, NoSafeProgram) as error:
        scale = f"{short(25.4 / picture.dpi, 5)} mm/px from its DPI" if picture.dpi else "not known"
        return PictureFacts((width, height), colour, scale, str(error), picture.notes)
    points = np.concatenate([contour.points for contour in part.contours])
    contours = counted(len(part.contours), "contour")
    segments = counted(len(points), "line or arc", "lines and arcs")
    return PictureFacts(
        (width, height),
        colour,
        part.units,
        f"{format_size(np.ptp(points, axis=0).tolist(), 2)} mm, {contours}, {segments}",
        part.notes,
    )


def _segment(source: Source, job: Job, files: Files) -> _Segmented:
    _check_settings(job)
    sensor = is_of_sensor(job.camera)
    picture = _linearize(read_picture(source, sensor=sensor, meanwhile=files.meanwhile), job)
    camera = read_camera(files.read(job.camera.file)) if job.camera.file else None
    plane = _find_plane(picture, camera, job.camera)
    # A lens that was estimated from a sheet makes the view, but it does not count as calibrated.
    used = plane.lens.camera if plane is not None and plane.lens is not None else camera
    method = _Method(used, plane, job, _is_masked_by_alpha(picture, job.image))
    empty = _read_second(picture, job, files, "background") if job.image.background else None
    if job.image.lamp_moved:
        other = _read_second(picture, job, files, "lamp_moved")
        picture = replace(picture, pixels=remove_shadows(picture.pixels, other.pixels, other.name))
    region, is_located = _find_region(job, plane), False
    if region is None and picture.pixels.size > _LARGE:
        region, area = _locate_part(method, picture, empty)
        is_located = region is not None
    view, mask = _make_mask(method, picture, empty, region, 1)
    if is_located:
        fine_area = _measure_area_mm2(view, mask)
        if fine_area < _SAME_PART * area:
            raise NoSafeProgram(
                picture.name,
                f"a reduced picture shows a part of {area:.0f} mm2, "
                f"the full one shows {fine_area:.0f} mm2",
                remedy="part and bench hardly differ: light it evenly, "
                "or choose another image.mask",
            )
    if region is not None and job.image.region is None:
        view = replace(view, notes=(*view.notes, _note_region(region, is_located)))
    return _Segmented(picture, camera, plane, view, mask)


def _read_second(picture: Picture, job: Job, files: Files, key: str) -> Picture:
    """The photo of the key `background` or `lamp_moved`, which was taken from the same position.

    Raises InputError if its size or its colours differ.
    """
    file = files.read(getattr(job.image, key))
    second = _linearize(read_picture(file, sensor=is_of_sensor(job.camera)), job)
    if second.pixels.shape == picture.pixels.shape:
        return second
    differ = "size" if second.pixels.shape[:2] != picture.pixels.shape[:2] else "colors"
    raise InputError(
        second.name,
        f"differs in {differ} from the photo of the part",
        f"[image] {key}",
        "take both with the same camera and settings from the same place",
    )


def _check_settings(job: Job) -> None:
    image, camera = job.image, job.camera
    has_pairs = camera.points_px is not None or bool(camera.markers)
    has_plane = has_pairs or camera.plane_from is not None
    has_sheet = bool(camera.markers) and not _BOARD.fullmatch(camera.markers)
    for setting, has_no_effect, why in (
        (
            "[image] mm_per_px",
            has_plane and image.mm_per_px is not None,
            "the work plane gives the scale",
        ),
        (
            "[image] width_mm",
            has_plane and image.width_mm is not None,
            "the work plane gives the scale",
        ),
        ("[camera] height", bool(camera.height) and not has_pairs, "it is for points and markers"),
        (
            "[camera] printed_length",
            camera.printed_length != RULER and not has_sheet,
            "no sheet is used",
        ),
        (
            "[image] background",
            bool(image.background) and image.mask not in ("auto", "background"),
            f'mask = "{image.mask}" does not use it',
        ),
        (
            "[image] threshold",
            image.mask == "alpha" and image.threshold is not None,
            'mask = "alpha" takes what is half opaque',
        ),
        (
            "[image] color",
            image.mask == "alpha" and image.color is not None,
            'mask = "alpha" does not use it',
        ),
        ("[image] lines", image.lines != "auto", "it is for drawings that are traced"),
    ):
        if has_no_effect:
            raise JobError(setting, f"has no effect: {why}", remedy="leave one of the two out")


def _note_region(region: Region, is_located: bool) -> Note:
    listed = format_size(region, 2, ", ")
    why = "the free area of the marker sheet, less with the height of the part"
    if is_located:
        why = f"the part was found there in a picture {_COARSER} times coarser"
    return Note(
        "assumed",
        f"examined in full resolution: [{listed}] mm only",
        f"{why}; set image.region for another",
    )


def _linearize(picture: Picture, job: Job) -> Picture:
    """The picture with values proportional to light, by the curve of IEC 61966-2-1.

    Blur of lens and sensor acts on light, and so does the threshold at an edge.
    """
    if job.image.tones == "linear":
        return picture
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    coded = np.arange(256) / 255
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    pixels = cv2.LUT(picture.pixels, (light * 255).round().astype(np.uint8))
    return replace(picture, pixels=np.asarray(pixels, dtype=np.uint8))


class _Method(Struct, frozen=True):
    """How a picture becomes a view and a mask.

    camera: calibrated or estimated camera, None without one.
    plane: the work plane, None for a picture that is to scale.
    job: the settings.
    by_alpha: whether the transparency of the picture is the mask.
    """

    camera: Camera | None
    plane: Plane | None
    job: Job
    by_alpha: bool


def _is_masked_by_alpha(picture: Picture, table: ImageTable) -> bool:
    """Whether the transparency of the picture is the mask.

    Raises JobError if the job asks for it and the picture is opaque.
    """
    if table.mask == "alpha":
        if picture.alpha is None:
            raise JobError(
                "[image] mask",
                f'"alpha" needs transparency, {picture.name} is opaque everywhere',
                remedy="save it with its transparency",
            )
        return True
    others = table.background or table.threshold is not None or table.color is not None
    if table.mask != "auto" or others or table.invert or picture.alpha is None:
        return False
    return is_cut_out(picture.alpha)


def _make_mask(
    method: _Method, picture: Picture, empty: Picture | None, region: Region | None, coarser: int
) -> tuple[ScaledView, Mask]:
    view, examined = _make_view(method, picture, region, coarser), coarser == 1
    if method.by_alpha and picture.alpha is not None:
        opaque = _make_view(method, replace(picture, pixels=picture.alpha), region, coarser)
        table = replace(method.job.image, mask="alpha")
        return view, make_mask(opaque, table, None, picture.name, examined=examined)
    background = None if empty is None else _make_view(method, empty, region, coarser)
    table = method.job.image
    kinds = {method.job.operation.kind, *(step.operation.kind for step in method.job.operations)}
    if not kinds.isdisjoint(_PATTERN_KINDS):
        table = replace(table, accept=[*table.accept, "specks"])
    return view, make_mask(view, table, background, picture.name, examined=examined)


def _measure_area_mm2(view: ScaledView, mask: Mask) -> float:
    return float(np.count_nonzero(mask.pixels)) * view.mm_per_px**2


def _locate_part(
    method: _Method, picture: Picture, empty: Picture | None
) -> tuple[Region | None, float]:
    """The region of the part and some bench around it, and the area of the part, mm2.

    They are found in a coarse view. None if no part is found there.
    """
    try:
        view, mask = _make_mask(method, picture, empty, None, _COARSER)
    except InputError:
        return None, 0.0  # the fine view finds the part, or reports why not
    columns, rows = np.flatnonzero(mask.pixels.any(axis=0)), np.flatnonzero(mask.pixels.any(axis=1))
    height, width = mask.pixels.shape
    size = max(np.ptp(columns), np.ptp(rows))
    margin = max(_MIN_MARGIN_PX, round(_MARGIN_FRACTION * size))
    left, right = max(columns[0] - margin, 0), min(columns[-1] + margin, width - 1)
    top, bottom = max(rows[0] - margin, 0), min(rows[-1] + margin, height - 1)
    corners = view.work_from_view @ np.array([[left, right], [bottom, top], [1.0, 1.0]])
    x0, y0, x1, y1 = corners.T.ravel().tolist()
    return (x0, y0, x1, y1), _measure_area_mm2(view, mask)


def _find_plane(picture: Picture, camera: Camera | None, table: CameraTable) -> Plane | None:
    """The work plane by points, by a pose or by markers; None for a picture that is to scale.

    Raises JobError if several of them are given, or one of them is incomplete.
    """
    is_given = {
        "points_px": table.points_px is not None or table.points_mm is not None,
        "plane_from": table.plane_from is not None,
        "markers": bool(table.markers),
    }
    given = list(compress(is_given, is_given.values()))
    if len(given) > 1:
        raise JobError(
            "[camera]", f"{' and '.join(given)} are both given", remedy="give one of them"
        )
    if is_given["points_px"]:
        return _find_plane_by_points(picture, camera, table)
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


def _find_plane_by_points(picture: Picture, camera: Camera | None, table: CameraTable) -> Plane:
    """The work plane by points. A plane above them needs a lens, which is estimated from them."""
    if table.points_px is None or table.points_mm is None:
        raise JobError(
            "[camera]", "points_px and points_mm belong together", remedy="give both, in one order"
        )
    plane = fit_plane(camera, table.points_px, table.points_mm)
    if not table.height:
        return plane
    if camera is not None:
        return fit_plane(camera, table.points_px, table.points_mm, height=table.height)
    height, width = picture.pixels.shape[:2]
    px, mm, size = plane.pairs_px, plane.pairs_mm, (width, height)
    fitted = fit_sheet_lens(px, mm, size, needs_focal=True, focal_px=picture.focal_px)
    lens = check_focal_length(fitted)
    plane = fit_plane(lens.camera, table.points_px, table.points_mm, height=table.height)
    return replace(plane, lens=lens, notes=(lens.note, *plane.notes))


def _make_view(
    method: _Method, picture: Picture, region: Region | None, coarser: int
) -> ScaledView:
    if method.plane is not None:
        return rectify(picture, method.camera, method.plane, region, coarser)
    if method.camera is not None:
        raise JobError(
            "[camera]",
            "a lens without a work plane",
            remedy="give [camera] points_px and points_mm, plane_from, or markers",
        )
    table = method.job.image
    return cut_out(make_scaled_view(picture, table.mm_per_px, table.width_mm), region, coarser)


def _find_region(job: Job, plane: Plane | None) -> Region | None:
    """The region of the job, or else the free area of a sheet: its markers look like parts.

    None if the whole picture is used. Raises JobError for a board without a region.
    """
    values = job.image.region
    if values is None:
        target = find_target(job.camera) if job.camera.markers else None
        if isinstance(target, Board):
            raise JobError(
                "[camera] markers",
                "a board on the bench looks like a part",
                remedy="give [image] region = [x from, y from, x to, y to], "
                "mm from the board's lower left corner",
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
    """The free area of a sheet as it appears in the work plane, mm.

    Above the sheet, the lines of sight from the area to the camera enclose a smaller rectangle. It
    is moved towards the point below the camera. The marks of the origin touch the area, and are
    kept outside by their width.

    Raises JobError if nothing of the area remains.
    """
    corners = map_points(plane.work_from_pairs, np.array([(0.0, 0.0), paper.free]))
    margin = STROKE if np.any(plane.work_from_pairs != np.eye(3)) else 0.0
    (x0, y0), (x1, y1) = corners[0] + margin, corners[1] - margin
    if x0 >= x1 or y0 >= y1:
        raise JobError(
            "[camera] height",
            f"at this height nothing of the free area of the {paper.label} is left",
            remedy="take the photo from higher up",
        )
    return float(x0), float(y0), float(x1), float(y1)


def find_target(table: CameraTable) -> Sheet | Board:
    """The sheet or the board on the bench."""
    squares = _BOARD.fullmatch(table.markers)
    if squares is None:
        return make_sheet(table.markers, table.marker, table.printed_length)
    return Board(int(squares[1]), int(squares[2]), table.square, table.marker)


def _find_frame(seen: _Segmented) -> FloatArray:
    """(N, 2) border of the view in the photo, px."""
    height, width = seen.picture.pixels.shape[:2]
    if seen.plane is None:
        right, bottom = width - 1.0, height - 1.0
        return np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]])
    return sample_border(seen.view, seen.camera, seen.plane, (width, height))


def _note_placement(
    seen: _Segmented, outlines_px: Sequence[FloatArray], job: Job
) -> Iterator[Note]:
    """Notes on the error bound of the outlines.

    The corners of a sheet or a board are examined for their lens; points are too few for that.
    Raises NoSafeProgram if a lens that is not calibrated may move the outlines too far.
    """
    plane = seen.plane
    if plane is None or not len(plane.pairs_px) or not outlines_px:
        return
    matrix = seen.view.work_from_view
    outline = np.concatenate(outlines_px) @ matrix[:, :2].T + matrix[:, 2]
    height, width = seen.picture.pixels.shape[:2]
    step = max(1, len(outline) // _BOUND_POINTS)
    bound = compute_error_bound(plane, seen.camera, (width, height), outline[::step])
    distance = f"up to {short(bound.outside, 1)} mm outside of the points that gave the work plane"
    is_calibrated = seen.camera is not None and plane.lens is None
    is_outside = not is_calibrated and bound.outside > _OUTSIDE_MM
    is_examined = bool(job.camera.markers) and len(plane.pairs_px) >= LEAST_CORNERS
    limit = _EXAMINED_MM if is_examined else job.tolerance.chord
    by_lens = bound.noise + bound.lens
    if is_outside and bound.known and by_lens > limit and "outside" not in job.image.accept:
        raise NoSafeProgram(
            seen.picture.name,
            f"the part lies {distance}, without a calibrated lens: "
            f"it may be {_format_mm(bound.total)} off",
            remedy="give camera.file (camgen calibrate), lay the sheet or board around the part, "
            'or set image.accept = ["outside"]',
        )
    if bound.known:
        yield _note_bound(bound, is_calibrated)
    if is_outside and not (is_examined and by_lens <= _LENS_MM):
        total = _format_mm(bound.total) if bound.known else "unknown, there are too few points"
        yield Note(
            "warning",
            f"the part lies {distance}, without a calibrated lens",
            f"how far off it may be: {total}; "
            "give camera.file, or lay sheet or board around the part",
            strict="outside" not in job.image.accept,
        )
    elif bound.lens > _LENS_MM:
        what = f"no camera.file is given, and a lens may move the part by {_format_mm(bound.lens)}"
        yield Note("warning", what, "the points do not lie as without a lens")
    if bound.height > _LENS_MM:
        yield Note(
            "warning",
            f"the height may move the part by {_format_mm(bound.height)}",
            "the focal length is from the photo: tilt the camera more, or give camera.file",
            strict=True,
        )


def _note_bound(bound: ErrorBound, is_calibrated: bool) -> Note:
    lens = "the lens as calibrated" if is_calibrated else f"{_format_mm(bound.lens)} by the lens"
    if bound.height:
        lens += f", {_format_mm(bound.height)} by the height and the focal length"
    outside = "inside of the points"
    if bound.outside > _OUTSIDE_MM:
        outside = f"up to {short(bound.outside, 1)} mm outside of the points"
    return Note(
        "assumed",
        f"the part is placed to within {_format_mm(bound.total)}",
        f"{_format_mm(bound.noise)} by the noise of the points, {lens}; the part lies {outside}",
    )


def _format_mm(value: float) -> str:
    return f"{max(value, 0.001):.3f} mm"


def _note_height(table: CameraTable) -> tuple[Note, ...]:
    """A note on a height of 0. A thick part on markers would be too large and displaced."""
    if table.height or not (table.markers or table.points_px):
        return ()
    noun = "sheet" if table.markers else "points"
    if _BOARD.fullmatch(table.markers):
        noun = "board"
    calibration = "" if table.markers else ", with camera.file,"
    return (
        Note(
            "assumed",
            f"height 0: the part's upper face lies in the plane of the {noun}",
            f"camera.height{calibration} says how far above it",
        ),
    )


def _note_wall(seen: _Segmented, borders: Sequence[FloatArray], job: Job) -> tuple[Note, ...]:
    """A warning on a side wall of the part in the picture.

    If no height is given, the wall moves the outline. If one is given, an outline along the foot of
    the wall is wrong.
    """
    if seen.plane is None or not job.camera.markers or not borders:
        return ()
    cameras = list_cameras(seen.picture, seen.plane, seen.camera)
    matrix = seen.view.work_from_view
    wall = find_side_wall(seen.view.pixels, seen.mask.pixels, matrix, borders, seen.plane, cameras)
    if wall is None:
        return ()
    given = job.camera.height
    if given:
        if not wall.is_part or abs(wall.highest - given) > _SAME_HEIGHT * given:
            return ()
        return (
            Note(
                "warning",
                "the outline runs along the foot of a side wall, "
                f"up to {_format_mm(wall.width)} off",
                "give image.threshold between the tones of wall and upper face, or light the walls",
                strict=True,
            ),
        )
    height = f"about {short(wall.highest, 1)} mm"
    if wall.lowest < wall.highest:
        height = f"{short(wall.lowest, 1)} to {short(wall.highest, 1)} mm"
    return (
        Note(
            "warning",
            f"a side wall of the part is in the picture, {height} high",
            f"that moves the outline by up to {short(wall.shift, 1)} mm: give camera.height",
            strict=True,
        ),
    )


def _note_steps(seen: _Segmented) -> tuple[Note, ...]:
    notes = [*seen.picture.notes]
    plane = seen.plane
    if plane is not None:
        notes += plane.notes
        if len(plane.residuals_mm):
            rms, largest = short(plane.rms_mm, 4), short(plane.max_mm, 4)
            what = f"work plane from {len(plane.residuals_mm)} points, rms {rms} mm"
            notes.append(Note("assumed", f"{what}, largest {largest} mm"))
    notes += [*seen.view.notes, Note("assumed", f"part by {seen.mask.method}", seen.mask.why)]
    return (*notes, *seen.mask.notes)
