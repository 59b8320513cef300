"""The image-space planner, compared in the work frame with formulas for discs and corners."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import camgen
from camgen.geometry.rings import apply_hysteresis, make_rings
from camgen.geometry.segments import BoolArray
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job, OperationTable, ProcessTable, ToleranceTable, ToolTable
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.plan.image_space import image_space
from camgen.plan.image_space.border import fit_border
from camgen.plan.image_space.field import Pixels, compute_gradient, find_chains
from camgen.plan.image_space.stretches import compute_ratios
from camgen.plan.image_space.tool_path import (
    Limits,
    choose_needed,
    compute_feeds,
    mark_spaced,
    measure_runs,
    sharpen_corners,
    smooth,
)
from camgen.plan.unused import check_idle
from tests.plan.test_follow import measure_signed_area

SCALE = 0.143
TOOL = 6.0
FEED, FORCE = 10.0, 5.0


def grid(size: int) -> tuple[FloatArray, FloatArray]:
    v, u = np.mgrid[:size, :size].astype(np.float64)
    return u, v


def mask(inside: BoolArray) -> Pixels:
    return np.where(inside, 255, 0).astype(np.uint8)


def polygon(size: int, corners: list[tuple[float, float]]) -> BoolArray:
    """Mask of the pixels whose centres lie inside, by the crossings of a ray to the right."""
    u, v = grid(size)
    inside = np.zeros(u.shape, dtype=bool)
    for (u0, v0), (u1, v1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if v0 != v1:
            inside ^= ((v0 > v) != (v1 > v)) & (u < u0 + (v - v0) * (u1 - u0) / (v1 - v0))
    return inside


def rotate_corners(
    corners: list[tuple[float, float]], degrees: float, centre: complex
) -> list[tuple[float, float]]:
    points = [complex(*c) * np.exp(1j * np.radians(degrees)) + centre for c in corners]
    return [(p.real, p.imag) for p in points]


def rectified(scale: float, height: int) -> FloatArray:
    """Matrix work_from_view: v runs against y, and the origin is the lower left pixel."""
    return np.array([[scale, 0.0, 0.0], [0.0, -scale, scale * (height - 1)]])


def plan_mask(
    pixels: Pixels,
    scale: float = SCALE,
    *,
    exact: bool = True,
    diameter: float = TOOL,
    **operation: object,
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    process = ProcessTable(feed=FEED, force=FORCE)
    job = Job(
        tool=ToolTable(diameter=diameter), operation=OperationTable(**operation), process=process
    )  # type: ignore[arg-type]
    return image_space(pixels, rectified(scale, len(pixels)), job, exact=exact)


def disc(
    radius: float, u0: float = 0.3, v0: float = 0.7, margin: int = 20
) -> tuple[Pixels, complex, int]:
    """A picture of a disc, the centre of the disc (px), and the size of the picture (px)."""
    size = int(2 * radius) + 2 * margin
    u, v = grid(size)
    middle = complex(size // 2 + u0, size // 2 + v0)
    return mask((u - middle.real) ** 2 + (v - middle.imag) ** 2 <= radius**2), middle, size


def convert_to_work(point: complex, scale: float, size: int) -> complex:
    return complex(scale * point.real, scale * (size - 1 - point.imag))


def list_positions(path: ToolPath) -> np.ndarray:
    return path.position[:, 0] + 1j * path.position[:, 1]


def list_press_directions(path: ToolPath) -> np.ndarray:
    """Direction of the force at the end of each segment, as complex numbers."""
    return path.force_direction[1:, 1, 0] + 1j * path.force_direction[1:, 1, 1]


@pytest.mark.parametrize("scale", [0.05, SCALE, 0.4])
def test_a_path_around_a_disc_is_a_circle(scale: float) -> None:
    radius = 14.0 / scale
    pixels, centre, size = disc(radius)
    (path,), notes = plan_mask(pixels, scale)
    arm = list_positions(path) - convert_to_work(centre, scale, size)
    deviation = np.abs(arm) - 17.0
    assert np.abs(deviation).max() < 0.4 * scale
    assert np.sqrt((deviation**2).mean()) < 0.12 * scale
    # The force points from the tool to the part, so to the centre of the disc.
    angle = np.degrees(np.angle(-list_press_directions(path) / arm[1:]))
    assert np.abs(angle).max() < 2.5
    # Eq. 11: the contact point keeps the nominal feed, so the tool centre runs (R + d) / R of it.
    assert path.feed == pytest.approx(FEED * 17 / 14, rel=0.08)
    assert (path.force == FORCE).all()
    assert path.closed
    assert path.position[0] == pytest.approx(path.position[-1])
    assert not path.position[:, 2].any()
    assert (path.axis == (0.0, 0.0, -1.0)).all()
    assert notes == ()


def test_a_path_along_whole_pixels_deviates_by_a_pixel() -> None:
    pixels, centre, size = disc(100.0)
    (path,), _ = plan_mask(pixels, exact=False)
    deviation = (
        np.abs(list_positions(path) - convert_to_work(centre, SCALE, size)) - (100 * SCALE + 3)
    ) / SCALE
    # Border pixels lie inside the offset mask, by half a pixel on average.
    # The pixels of the part lie inside its border, too.
    assert -1.1 < deviation.mean() < -0.4
    assert np.abs(deviation).max() < 2.0
    angle = np.degrees(
        np.angle(
            -list_press_directions(path)
            / (list_positions(path) - convert_to_work(centre, SCALE, size))[1:]
        )
    )
    assert np.abs(angle).max() < 6.0
    (exact,), _ = plan_mask(pixels)
    exact_deviation = (
        np.abs(list_positions(exact) - convert_to_work(centre, SCALE, size)) - (100 * SCALE + 3)
    ) / SCALE
    assert np.sqrt((exact_deviation**2).mean()) < np.sqrt((deviation**2).mean()) / 5


@pytest.mark.parametrize(("direction", "sign"), [("climb", -1), ("any", -1), ("conventional", 1)])
def test_a_path_inside_a_hole_runs_against_the_one_around_the_part(
    direction: str, sign: int
) -> None:
    size, middle = 500, complex(250.4, 249.8)
    u, v = grid(size)
    distance = np.hypot(u - middle.real, v - middle.imag)
    (outline, hole), notes = plan_mask(
        mask((distance <= 200) & (distance > 80)), direction=direction
    )
    arm = list_positions(hole) - convert_to_work(middle, SCALE, size)
    assert np.abs(arm) == pytest.approx(80 * SCALE - 3, abs=0.4 * SCALE)
    assert np.abs(np.degrees(np.angle(list_press_directions(hole) / arm[1:]))).max() < 3.0
    assert hole.feed == pytest.approx(FEED * (80 * SCALE - 3) / (80 * SCALE), rel=0.1)
    assert (outline.id, hole.id) == ("c1", "c2")
    assert (outline.parent, hole.parent) == (-1, 0)
    # Climb milling has the part on the right: clockwise around it, counter-clockwise in its hole.
    assert np.sign(measure_signed_area(outline)) == sign
    assert np.sign(measure_signed_area(hole)) == -sign
    assert notes == ()


def test_a_conventional_path_is_the_climb_path_reversed() -> None:
    pixels, *_ = disc(40.0)
    (climb,), _ = plan_mask(pixels)
    (other,), _ = plan_mask(pixels, direction="conventional")
    backwards = climb.reversed()
    for name in ("position", "force_direction", "force", "feed"):
        assert getattr(other, name) == pytest.approx(getattr(backwards, name))


@pytest.mark.parametrize("degrees", [0.0, 10.0, 33.0])
def test_a_path_around_a_square_rolls_about_its_corners_without_force(degrees: float) -> None:
    size, half = 520, 150.0
    centre = complex(260.3, 259.6)
    corners = rotate_corners(
        [(-half, -half), (half, -half), (half, half), (-half, half)], degrees, centre
    )
    (path,), _ = plan_mask(mask(polygon(size, corners)))
    # In the frame of the square, mm. Angles of the work frame run against those of the view.
    in_square = (list_positions(path) - convert_to_work(centre, SCALE, size)) * np.exp(
        1j * np.radians(degrees)
    )
    beyond = np.maximum(np.abs(in_square.real) - half * SCALE, 0) + 1j * np.maximum(
        np.abs(in_square.imag) - half * SCALE, 0
    )
    on_arc = (beyond.real > 0) & (beyond.imag > 0)
    # A side along the pixels is uncertain by half a pixel.
    # A mask does not show the tip of a corner.
    assert np.abs(beyond)[~on_arc] == pytest.approx(
        3.0, abs=(0.6 if degrees == 0 else 0.35) * SCALE
    )
    assert np.abs(beyond)[on_arc] == pytest.approx(3.0, abs=SCALE)
    assert on_arc.sum() > 4 * 8
    # The force is off while the tool rolls about a corner, and on along the sides.
    angle = np.degrees(np.angle(beyond))
    inner = on_arc & (angle > 20) & (angle < 70)
    side = ~on_arc & (
        np.minimum(np.abs(in_square.real), np.abs(in_square.imag)) < half * SCALE - 4.0
    )
    ends = np.arange(1, len(in_square))
    assert (path.force[ends[inner[1:] & inner[:-1]]] == 0).all()
    assert (path.force[ends[side[1:] & side[:-1]]] == FORCE).all()
    assert np.count_nonzero(np.diff(path.force[1:])) in (7, 8)
    assert path.feed.max() == pytest.approx(2 * FEED)
    assert (path.feed[ends[inner[1:] & inner[:-1]]] > 1.9 * FEED).all()
    assert path.feed[ends[side[1:] & side[:-1]]] == pytest.approx(FEED, rel=0.1)


def inner_corner(degrees: float, **operation: float) -> tuple[ToolPath, np.ndarray]:
    """A path around an L, and its positions in the frame of the inner corner.

    The corner is the origin of that frame, and the part lies at x < 0 or y < 0.
    """
    size, centre = 700, complex(350.2, 350.7)
    corners = [
        (-200.0, 200.0),
        (-200.0, -200.0),
        (0.0, -200.0),
        (0.0, 0.0),
        (200.0, 0.0),
        (200.0, 200.0),
    ]
    (path,), notes = plan_mask(
        mask(polygon(size, rotate_corners(corners, degrees, centre))), **operation
    )
    assert [note.kind for note in notes] == ["warning"]
    assert "not touched, most of it on c1" in notes[0].what
    return path, (list_positions(path) - convert_to_work(centre, SCALE, size)) * np.exp(
        1j * np.radians(degrees)
    )


@pytest.mark.parametrize("degrees", [0.0, 10.0, 33.0])
def test_an_inner_corner_without_a_radius_is_run_to_its_end_with_force(degrees: float) -> None:
    path, in_corner = inner_corner(degrees)
    kink = 3 + 3j
    nearest = np.abs(in_corner - kink).min()
    assert nearest < 0.35
    near = np.abs(in_corner[1:] - kink) < 6.0
    # In the corner the tool touches both sides.
    assert (path.force[1:][near] == FORCE).all()
    near_corner = (in_corner.real > -20) & (in_corner.imag > -20) & (np.abs(in_corner - kink) < 20)
    assert np.minimum(in_corner.real, in_corner.imag)[near_corner].min() > 3.0 - 0.7 * SCALE
    assert path.feed[1:][near].min() > 0.8 * FEED


@pytest.mark.parametrize("degrees", [0.0, 10.0, 33.0])
def test_an_inner_corner_with_a_radius_is_an_arc_without_force(degrees: float) -> None:
    path, in_corner = inner_corner(degrees, corner_radius=4.0)
    # Offset outwards by 7 mm and back by 4 mm: an arc of 4 mm about (7, 7).
    # It meets the offset curves of the sides, which lie 3 mm from the sides.
    arm = in_corner - (7 + 7j)
    arc = (arm.real < 0) & (arm.imag < 0) & (np.abs(arm) < 6)
    assert arc.sum() > 6
    # Both sides may deviate by half a pixel, and the middle of the arc by sqrt(2) times that.
    assert np.abs(arm[arc]) == pytest.approx(4.0, abs=0.85 * SCALE)
    middle = arc & (np.abs(np.degrees(np.angle(-arm)) - 45) < 15)
    assert (path.force[1:][middle[1:]] == 0).all()
    straight = (in_corner.real > 9) & (in_corner.real < 20) & (np.abs(in_corner.imag - 3) < 1)
    assert (path.force[1:][straight[1:] & straight[:-1]] == FORCE).all()
    # The direction turns evenly through the corner: on each segment in proportion to its length.
    turn = np.degrees(
        np.abs(np.angle(list_press_directions(path)[1:] * list_press_directions(path)[:-1].conj()))
    )
    step = np.abs(np.diff(in_corner))[1:]
    assert (turn[arc[2:]] < np.degrees(step[arc[2:]] / 4) + 6).all()


def test_a_note_gives_the_length_that_the_tool_does_not_touch() -> None:
    size = 700
    shape = [
        (150.5, 550.5),
        (150.5, 150.5),
        (350.5, 150.5),
        (350.5, 350.5),
        (550.5, 350.5),
        (550.5, 550.5),
    ]
    _, notes = plan_mask(mask(polygon(size, shape)))
    # A tool of radius d leaves the length d untouched on both sides of a square inner corner.
    assert float(notes[0].what.split()[0]) == pytest.approx(6.0, abs=0.8)


def test_a_note_lists_the_contours_that_are_too_narrow() -> None:
    u, v = grid(400)
    plate = (u > 50) & (u < 350) & (v > 50) & (v < 350)
    slot = (np.abs(v - 120) < 15) & (np.abs(u - 200) < 100)
    wide = np.hypot(u - 200, v - 250) < 40
    (outline, hole), notes = plan_mask(mask(plate & ~slot & ~wide))
    assert (outline.id, hole.id) == ("c1", "c3")
    assert [str(note) for note in notes] == [
        "skipped: 1 contour not followed, too narrow: c2 on layer image (a 6 mm tool does not fit)"
    ]
    _, with_radius = plan_mask(mask(plate & ~slot & ~wide), corner_radius=4.0)
    assert str(with_radius[0]) == (
        "skipped: 2 contours not followed, too narrow: c2, c3 on layer image "
        "(a 6 mm tool with corner radius 4 does not fit)"
    )


def test_two_discs_nearer_than_the_tool_have_one_path_around_them() -> None:
    u, v = grid(400)
    left, right = np.hypot(u - 140, v - 200) < 50, np.hypot(u - 260, v - 200) < 50
    (path,), notes = plan_mask(mask(left | right))
    assert path.id in ("c1", "c2")
    distance = np.minimum(
        *(
            np.abs(list_positions(path) - convert_to_work(complex(x, 200), SCALE, 400))
            for x in (140, 260)
        )
    )
    assert distance == pytest.approx(50 * SCALE + 3, abs=0.6 * SCALE)
    assert [note.kind for note in notes] == ["warning"]


def test_an_island_in_a_hole_has_its_own_path() -> None:
    u, v = grid(700)
    distance = np.hypot(u - 350.3, v - 350.1)
    paths, _ = plan_mask(mask(((distance < 320) & (distance > 200)) | (distance < 60)))
    assert [(path.id, path.parent) for path in paths] == [("c1", -1), ("c2", 0), ("c3", 1)]
    radii = [
        np.abs(list_positions(path) - convert_to_work(350.3 + 350.1j, SCALE, 700)).mean()
        for path in paths
    ]
    assert radii == pytest.approx([320 * SCALE + 3, 200 * SCALE - 3, 60 * SCALE + 3], abs=0.05)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 40.0, 200.0])
@pytest.mark.parametrize("exact", [True, False])
def test_the_force_points_to_the_part_in_the_work_frame(
    mirrored: bool, degrees: float, exact: bool
) -> None:
    """An ellipse in a view that is rotated in the work frame; v runs with or against y."""
    centre = np.array([170.3, 149.2])
    u, v = grid(340)
    pixels = mask(((u - centre[0]) / 120) ** 2 + ((v - centre[1]) / 70) ** 2 <= 1)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = SCALE * np.array([[c, -s], [s, c]]) @ np.diag([1.0, 1.0 if mirrored else -1.0])
    work_from_view = np.column_stack([matrix, [31.0, -7.0]])
    (path,), _ = image_space(
        pixels, work_from_view, Job(process=ProcessTable(force=FORCE)), exact=exact
    )
    # The contact point of eq. 10, transformed to the view, lies on the ellipse.
    contact = path.position[1:, :2] + 3.0 * path.force_direction[1:, 1, :2]
    at = (contact - work_from_view[:, 2]) @ np.linalg.inv(matrix).T - centre
    level = np.hypot(at[:, 0] / 120, at[:, 1] / 70)
    assert level == pytest.approx(1.0, abs=0.01 if exact else 0.03)
    assert np.linalg.norm(path.force_direction, axis=2) == pytest.approx(1.0)
    # Climb milling: the part is on the right, seen from above, whatever the pose of the view.
    assert measure_signed_area(path) < 0


def test_the_path_has_the_passes_and_the_direction_of_the_job() -> None:
    pixels, *_ = disc(40.0)
    (path,), _ = plan_mask(pixels, depth=3.0, passes=2)
    assert path.depths == (1.5, 3.0)
    assert not path.reversible


def test_given_borders_replace_those_of_the_mask() -> None:
    size, middle = 500, complex(250.4, 249.8)
    u, v = grid(size)
    distance = np.hypot(u - middle.real, v - middle.imag)
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    circle = np.column_stack([middle.real + np.cos(turn) * 200, middle.imag + np.sin(turn) * 200])
    hole = np.column_stack([middle.real + np.cos(turn) * 80, middle.imag + np.sin(turn) * 80])
    job = Job(process=ProcessTable(feed=FEED, force=FORCE))
    view = rectified(SCALE, size)
    paths, _ = image_space(
        mask((distance <= 200) & (distance > 80)), view, job, borders=[circle, hole]
    )
    for path, radius in zip(paths, (200 * SCALE + 3, 80 * SCALE - 3), strict=True):
        assert np.abs(list_positions(path) - convert_to_work(middle, SCALE, size)) == pytest.approx(
            radius, abs=0.02 * SCALE
        )
    assert paths[1].feed == pytest.approx(FEED * (80 * SCALE - 3) / (80 * SCALE), rel=0.01)


def test_redundant_waypoints_are_left_out_and_the_path_stays() -> None:
    size, half, centre = 520, 150.0, complex(260.3, 259.6)
    corners = rotate_corners(
        [(-half, -half), (half, -half), (half, half), (-half, half)], 20, centre
    )
    pixels = mask(polygon(size, corners))
    view, tool = rectified(SCALE, size), ToolTable(diameter=TOOL)
    spacing = OperationTable(waypoint_spacing=0.5)
    chords = [ToleranceTable(chord=chord) for chord in (1e-7, 0.01)]
    jobs = [Job(tool=tool, operation=spacing, tolerance=chord) for chord in chords]
    (complete,), (reduced,) = (image_space(pixels, view, job)[0] for job in jobs)
    assert len(reduced.position) < len(complete.position) / 3
    begin, end = list_positions(reduced)[:-1], list_positions(reduced)[1:]
    segment = end - begin
    points = list_positions(complete)[:, None]
    fraction = np.clip(((points - begin) * segment.conj()).real / np.abs(segment) ** 2, 0, 1)
    assert np.abs(points - begin - fraction * segment).min(axis=1).max() <= 0.01 + 1e-9


def test_spacing_and_turn_of_waypoints_are_settings() -> None:
    pixels, *_ = disc(200.0)
    view, loose = rectified(SCALE, len(pixels)), ToleranceTable(chord=0.5)

    def count(**operation: float) -> int:
        job = Job(operation=OperationTable(**operation), tolerance=loose)  # type: ignore[arg-type]
        (path,), _ = image_space(pixels, view, job)
        return len(path.position) - 1

    # Around a path of 31.6 mm radius the force direction turns by 1.8 deg/mm.
    around = 2 * np.pi * (200 * SCALE + 3)
    assert count(waypoint_spacing=1.0, waypoint_turn=0.5) == pytest.approx(around / 1.0, rel=0.1)
    assert count(waypoint_spacing=4.0, waypoint_turn=0.5) == pytest.approx(around / 4.0, rel=0.1)
    assert count(waypoint_spacing=1.0, waypoint_turn=4.0) < around / 2.0
    # Waypoints are not closer than the pixels.
    assert count(waypoint_spacing=0.001, waypoint_turn=0.5) == pytest.approx(
        around / SCALE, rel=0.1
    )


@pytest.mark.parametrize("setting", [{"waypoint_spacing": 0.5}, {"waypoint_turn": 1.0}])
def test_the_geometric_planner_refuses_the_settings_of_waypoints(setting: dict[str, float]) -> None:
    points = np.array([[0.0, 0.0], [30, 0], [30, 20], [0, 20]])
    part = camgen.part(points)
    job = Job(operation=OperationTable(**setting))  # type: ignore[arg-type]
    with pytest.raises(JobError, match=r"no effect on a drawing \(operation\.waypoint_"):
        camgen.plan(part, job)
    with pytest.raises(
        JobError, match=r"no effect on the geometric planner \(operation\.waypoint_"
    ):
        check_idle(job, "the geometric planner")
    check_idle(job, "a picture")


def test_the_filter_does_not_depend_on_the_start_of_the_curve() -> None:
    table = make_rings([90])
    turn = 2 * np.pi * np.arange(90) / 90
    slow, fast = np.exp(1j * turn) * 5, 0.5 * np.cos(40 * turn)
    count = np.array([30])
    # A wave far below the cut-off frequency passes (eq. 13), a wave above it is removed.
    # 30 of 90 points are marked, so every third.
    assert smooth(table, count, slow + 3)[0] == pytest.approx(slow + 3, abs=0.005)
    (filtered,) = smooth(table, count, slow + fast)
    assert filtered == pytest.approx(slow, abs=0.01)
    assert smooth(table, count, np.roll(slow + fast, 1))[0] == pytest.approx(np.roll(filtered, 1))
    assert np.flatnonzero(mark_spaced(table, count)).tolist() == list(range(0, 90, 3))


def test_waypoints_are_spaced_on_each_curve() -> None:
    table = make_rings([40, 60])
    rows = np.flatnonzero(mark_spaced(table, np.array([10, 25])))
    assert rows[:10].tolist() == list(range(0, 40, 4))
    assert len(rows) == 35
    assert set(np.diff(rows[10:]).tolist()) == {2, 3}
    # With a point for each pixel the filter changes nothing.
    points = np.exp(2j * np.pi * np.arange(100) / 7)
    assert smooth(table, table.count, points)[0] == pytest.approx(points)


def test_the_removal_of_waypoints_keeps_the_tolerance_and_the_changes_of_force() -> None:
    x = np.arange(0.0, 101.0)
    points = x + 1j * 0.4 * np.sin(x / 15)
    press = np.full(len(x), -1j)
    switched = (x == 30) | (x == 60)
    ends, each = np.array([0, len(x)]), np.ones(len(x), dtype=bool)
    keep = choose_needed(ends, points, press, each, switched, Limits(1e-3, 0.05))
    assert keep[[0, 30, 60, 100]].all()
    assert keep.sum() < 30
    left = np.interp(x, x[keep], points.imag[keep])
    assert np.abs(left - points.imag).max() <= 0.05
    straight = choose_needed(ends, x + 0j, press, each, ~each, Limits(1e-3, 0.05))
    assert np.flatnonzero(straight).tolist() == [0, 100]


def test_waypoints_at_the_spacing_stay_on_a_curve() -> None:
    turn = np.linspace(0, np.pi, 121)
    points, press = 100 * np.exp(1j * turn), -np.exp(1j * turn)
    at_spacing = np.arange(121) % 4 == 0
    none = np.zeros(121, dtype=bool)
    keep = choose_needed(np.array([0, 121]), points, press, at_spacing, none, Limits(1e-3, 10.0))
    # The waypoints are 6 deg apart. The direction of the force may deviate by 1 deg
    # from the line between two of them, and here it turns evenly.
    assert (keep == at_spacing).all()
    finer = choose_needed(np.array([0, 121]), points, press, at_spacing, none, Limits(1e-3, 0.02))
    assert finer[at_spacing].all()
    assert finer.sum() > at_spacing.sum()


def simulate_ratios(
    *pieces: tuple[int, float], noise: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Length that the contact point runs per px of the tool centre, with noise and without.

    pieces: length of each piece in px and its ratio.
    """
    true = np.concatenate([np.full(size, ratio) for size, ratio in pieces])
    errors = np.random.default_rng(5).normal(0, noise, len(true))
    return true + errors - np.roll(errors, 1), true


@pytest.mark.parametrize("shift", [0, 1, 37, 95])
def test_the_ratio_follows_the_curvature(shift: int) -> None:
    """The curve is a line, an inner arc, a line, an outer arc, a line and a corner.

    The inner arc is shorter than the radius of the tool. The noise is that of a photo.
    """
    along, true = simulate_ratios(
        (90, 1.0), (18, 4.0), (100, 1.0), (190, 0.73), (60, 1.0), (52, 0.0), noise=0.6
    )
    table = make_rings([len(true)])
    ratios = np.roll(compute_ratios(table, np.roll(along, shift), np.ones(len(true)), 0.7), -shift)
    joints = np.array([[0], [90], [108], [208], [398], [458]])
    distance = np.abs((np.arange(len(true)) - joints + 255) % 510 - 255).min(axis=0)
    assert ratios[distance > 2] == pytest.approx(true[distance > 2], abs=0.06)
    # The ends of the arc are sharp: it has no peak there, and no slow stretch next to it.
    assert np.abs(ratios / np.maximum(true, 1) - 1)[90:108].mean() < 0.1
    assert (np.abs(ratios - true) > 0.06).sum() <= 8


def test_the_ratio_of_a_smooth_curve_has_no_steps() -> None:
    true = 1 + 0.5 * np.sin(2 * np.pi * np.arange(800) / 800)
    errors = np.random.default_rng(3).normal(0, 0.4, 800)
    ratios = compute_ratios(
        make_rings([800]), true + errors - np.roll(errors, 1), np.ones(800), 0.7
    )
    assert ratios == pytest.approx(true, abs=0.1)
    assert np.abs(np.diff(ratios)).max() < 0.03


def test_two_curves_do_not_affect_each_other() -> None:
    along, _ = simulate_ratios((120, 1.0), (60, 0.0), (70, 2.0), noise=0.3)
    table = make_rings([250, 30])
    both = compute_ratios(table, np.concatenate([along, np.full(30, 3.0)]), np.ones(280), 0.5)
    assert both[:250] == pytest.approx(compute_ratios(make_rings([250]), along, np.ones(250), 0.5))
    assert both[250:] == pytest.approx(3.0)


def test_a_corner_that_a_photo_rounds_is_sharpened() -> None:
    """The contact point runs 6 px around a square corner.

    So the corner seems to have a radius of 6 / (pi / 2) = 3.8 px.
    """
    ratio, along = np.ones(200), np.ones(200)
    ratio[100:160] = 0.1 - 1e-6
    along[100:160] = 0.1
    press = np.exp(1j * np.interp(np.arange(200), [99, 159], [0, np.pi / 2]))
    sharpened = sharpen_corners(make_rings([200]), ratio, along, press, 0.1)
    # The tangents of the arc meet 3.8 px from its ends.
    # This length at both ends belongs to the lines.
    assert np.flatnonzero(sharpened < 0.5).tolist() == list(range(103, 157))
    shifted = (np.roll(values, 70) for values in (ratio, along, press))
    rolled = sharpen_corners(make_rings([200]), *shifted, 0.1)
    assert rolled == pytest.approx(np.roll(sharpened, 70))


def notch(size: int, scale: float) -> list[tuple[float, float]]:
    """Corners, px, of a plate with a notch whose inner corners are arcs of 6.35 mm."""
    turn = np.linspace(0, np.pi / 2, 60)
    arcs = [
        complex(x, 25.0) + 6.35 * np.exp(1j * (start - turn))
        for x, start in ((-10.0, np.pi), (10.0, np.pi / 2))
    ]
    corners = np.concatenate(
        [[-16.35 + 0j], *arcs, [16.35 + 0j], [38 + 0j, 38 + 50j, -38 + 50j, -38 + 0j]]
    )
    points = corners * np.exp(0.2j) / scale + complex(size / 2, size / 2) - 25j / scale
    return [(point.real, point.imag) for point in points.tolist()]


def test_the_feed_on_a_short_inner_arc_is_a_quarter() -> None:
    """On each arc the path has a radius of 1.59 mm, a quarter of the arc's 6.35 mm.

    Its length of 2.5 mm is a fraction of the diameter of the tool.
    """
    size, tool = 800, 9.525
    pixels = mask(polygon(size, notch(size, SCALE)))
    job = Job(tool=ToolTable(diameter=tool), process=ProcessTable(feed=5.0, force=2.0))
    (path,), _ = image_space(pixels, rectified(SCALE, size), job)
    step = np.abs(np.diff(list_positions(path)))
    slow = path.feed[1:] < 2.5
    # At both ends of both arcs the tool is slow for one more pixel.
    # The ends of the arcs are exact to a pixel.
    assert step[slow].sum() == pytest.approx(2 * 1.5875 * np.pi / 2 + 4 * SCALE, abs=0.5)
    assert path.feed[1:][slow] == pytest.approx(1.25, rel=0.05)
    straight = (path.feed[1:] > 2.5) & (path.force[1:] > 0)
    assert step[straight & (np.abs(path.feed[1:] / 5 - 1) > 0.05)].sum() < 0.5


def test_diagonal_steps_are_as_fast_as_straight_ones() -> None:
    # A border of pixels runs straight, then diagonally, and back. The force has one direction.
    points = np.array(
        [0, 1, 2, 3, 4 + 1j, 5 + 2j, 6 + 3j, 5 + 3j, 4 + 3j, 3 + 3j, 2 + 2j, 1 + 1j], dtype=complex
    )
    table = make_rings([len(points)])
    along, step = measure_runs(table, points, points + 20 * 1j)
    assert step.max() == pytest.approx(np.sqrt(2))
    assert along / step == pytest.approx(1.0)
    assert compute_feeds(along / step, np.ones(len(points), dtype=bool), 2.0) == pytest.approx(1.0)


def test_the_feed_is_limited_and_never_zero() -> None:
    contact = np.array([True, True, True, False])
    assert compute_feeds(np.array([0.0, 0.8, 1e6, 5.0]), contact, 2.0) == pytest.approx(
        [2.0, 1.25, 0.02, 1.0]
    )


def test_a_switch_with_hysteresis_does_not_flicker() -> None:
    gap = np.array([0.7, 0.2, 0.7, 0.9, 1.2, 0.8, 0.6, 1.1, 0.4, 0.7, 0.8])
    table = make_rings([len(gap)])
    state = apply_hysteresis(table, gap <= 0.5, gap > 1.0, True)
    assert state.tolist() == [True, True, True, True, False, False, False, False, True, True, True]
    # The curve is closed, so its start has the state of its end.
    assert apply_hysteresis(table, gap <= 0.1, gap > 1.1, True).tolist() == [False] * len(gap)
    turns_on, turns_off = np.array([False, True, False]), np.zeros(3, dtype=bool)
    state = apply_hysteresis(make_rings([2, 1]), turns_on, turns_off, False)
    assert state.tolist() == [True, True, False]


def test_the_gradient_of_a_plane_is_exact() -> None:
    u, v = grid(40)
    far = (0.6 * u - 0.8 * v + 50).astype(np.float32)
    for radius in (1, 2, 5):
        assert compute_gradient(far, np.array([20 + 20j, 12.3 + 25.8j]), radius) == pytest.approx(
            0.6 - 0.8j, abs=1e-4
        )


@pytest.mark.parametrize("degrees", [3.0, 17.0, 38.0])
def test_the_border_lies_between_the_pixels(degrees: float) -> None:
    size, half, centre = 360, 120.0, complex(180.3, 179.6)
    corners = rotate_corners(
        [(-half, -half), (half, -half), (half, half), (-half, half)], degrees, centre
    )
    _, points = fit_border(find_chains(mask(polygon(size, corners))))
    in_square = (points - centre) * np.exp(-1j * np.radians(degrees))
    deviation = np.maximum(np.abs(in_square.real), np.abs(in_square.imag)) - half
    side = np.minimum(np.abs(in_square.real), np.abs(in_square.imag)) < half - 8
    assert np.sqrt((deviation[side] ** 2).mean()) < 0.05
    assert np.abs(deviation).max() < 0.9


def test_specks_and_single_pixels_change_no_path_of_the_others() -> None:
    pixels, *_ = disc(60.0, margin=60)
    pixels[10, 10] = pixels[10, 200:203] = 255
    pixels[120, 120] = 0
    paths, notes = plan_mask(pixels)
    assert sorted(path.id for path in paths) == ["c1", "c2", "c3"]
    assert "too narrow: c4" in notes[0].what


@settings(max_examples=15)
@given(
    st.integers(0, 40),
    st.integers(0, 40),
    st.floats(15, 60),
    st.floats(10, 50),
    st.floats(0, 180),
    st.sampled_from([0.0, 2.0]),
)
def test_the_path_moves_with_the_part(
    du: int, dv: int, a: float, b: float, degrees: float, radius: float
) -> None:
    u, v = grid(200)
    in_ellipse = (u - 90 + 1j * (v - 80)) * np.exp(1j * np.radians(degrees))
    base = mask((in_ellipse.real / a) ** 2 + (in_ellipse.imag / b) ** 2 <= 1)
    (first,), _ = plan_mask(base, corner_radius=radius)
    (second,), _ = plan_mask(np.roll(base, (dv, du), axis=(0, 1)), corner_radius=radius)
    assert second.position - first.position == pytest.approx(
        np.broadcast_to((du * SCALE, -dv * SCALE, 0.0), first.position.shape), abs=1e-4
    )
    assert second.feed == pytest.approx(first.feed, rel=1e-3)


def test_a_job_that_a_picture_cannot_serve_is_refused() -> None:
    pixels, _, size = disc(30.0)
    view = rectified(SCALE, size)
    with pytest.raises(JobError, match=r'"left" is not known .*operation\.side'):
        image_space(pixels, view, Job(operation=OperationTable(side="left")))
    with pytest.raises(JobError, match=r"0\.2 mm is 1\.4 px of the view .*tool\.diameter"):
        image_space(pixels, view, Job(tool=ToolTable(diameter=0.2)))
    with pytest.raises(JobError, match=r"beside a part of .*tool\.diameter"):
        image_space(pixels, view, Job(tool=ToolTable(diameter=2000.0)))
    with pytest.raises(InputError, match="not to scale"):
        image_space(pixels, np.array([[0.1, 0.0, 0.0], [0.0, -0.11, 0.0]]), Job())
    with pytest.raises(InputError, match="not to scale"):
        image_space(pixels, np.full((2, 3), np.nan), Job())
    with pytest.raises(InputError, match="touches the border of the view"):
        image_space(pixels[:, 22:], view, Job())
    with pytest.raises(InputError, match="uint8"):
        image_space(pixels.astype(np.float64), view, Job())  # type: ignore[arg-type]
    assert image_space(np.zeros((9, 9), dtype=np.uint8), view, Job())[1][0].kind == "skipped"
