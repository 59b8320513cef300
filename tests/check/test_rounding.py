"""Blends at the poses of an edge: their deviation, their clearance, and the time they save."""

from functools import cache
from importlib import import_module
from itertools import pairwise, product
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from bench.robots.rfa import FREE, PARTS, make_job
from camgen.check.time import compute_cycle
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray, rotation_between
from camgen.model.program import Comment, Force, MoveC, MoveJ, MoveL, Output
from camgen.motion.corners import limit_blends
from camgen.pipeline import Result
from camgen.read.solid import mesh
from tests.support.files import source

Motion = MoveL | MoveC
#: Blend radius and distance from the corner at which the tool begins to rotate, mm: z5, z1 and z0
#: of RAPID.
ZONES = {5.0: 8.0, 1.0: 1.0, 0.3: 0.3}
CELL = {
    "robot": "IRB 2400",
    "base_from_work": [970, -10, 640, 0, 0, 0],
    "flange_from_tool": [-103.923, 0, 160, 0, -60, 0],
}
TOOL = {"axis_tilt": 15, "symmetric": True, "holder": [[-35, -35, 0, 35, 35, 100]]}
Tables = dict[str, dict[str, object]]


@pytest.fixture(scope="module")
def disc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate of 10 mm in the shape of half an ellipse of 60 x 20 mm with 24 sides.

    Its upper edges are a polyline and a line.
    """
    angles = np.linspace(0.0, np.pi, 25)
    ring = np.column_stack([30 + 30 * np.cos(angles), 20 * np.sin(angles)]).tolist()
    corners = [(*point, z) for z, point in product((0.0, 10.0), (*ring, (30.0, 10.0)))]
    n = len(ring)
    faces = []
    for i in range(n):
        j = (i + 1) % n
        faces += [
            (i, j, n + 1 + j),
            (i, n + 1 + j, n + 1 + i),
            (n, j, i),
            (2 * n + 1, n + 1 + i, n + 1 + j),
        ]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces
    ]
    file = tmp_path_factory.mktemp("disc") / "disc.obj"
    file.write_text("\n".join(lines))
    return file


def build_disc(disc: Path, controller: str = "rapid", **tables: dict[str, object]) -> Result:
    """Build the upper edges of the disc."""
    job: Tables = {
        "input": {"select": "e1, e2"},
        "operation": {"offset": 2},
        "tool": TOOL,
        "cell": CELL,
        **tables,
    }
    return camgen.build(disc, post=controller, job=job)


@cache
def build_paper_part() -> Result:
    """Build the first part of the paper; along its rims the tilt and roll of the tool change."""
    tables = make_job(mesh.read(source(PARTS / "rfa1.stl")), "IRB 2400")
    return camgen.build(
        PARTS / "rfa1.stl", post="rapid", job={**tables, "tool": {**tables["tool"], **FREE}}
    )


def list_corners(result: Result) -> list[tuple[Motion, Motion, Motion]]:
    """Corners along edges, each as three motions.

    The corner is between the last two. The first one ends at the start of the second.
    """
    motions = result.program.columns.moves
    return [
        (motions[k - 1], first, second)
        for k, (first, second) in enumerate(pairwise(motions))
        if isinstance(first, Motion)
        and isinstance(second, Motion)
        and first.work
        and second.work
        and first.path == second.path
    ]


def find_end(motion: Motion) -> FloatArray:
    """The target position of a motion, mm."""
    return np.array(motion.target.origin)


def measure_corner_angle(before: Motion, first: Motion, second: Motion) -> float:
    """The angle of a corner, rad.

    The tangent at an end of an arc is the chord of the arc, mirrored at the chord of that half.
    """
    directions = []
    for start, motion, at_end in ((before, first, True), (first, second, False)):
        chord = find_end(motion) - find_end(start)
        if isinstance(motion, MoveC):
            via = np.array(motion.via.origin)
            half = find_end(motion) - via if at_end else via - find_end(start)
            chord = 2 * half * (half @ chord) / (half @ half) - chord
        directions.append(chord)
    return float(np.arctan2(np.linalg.norm(np.cross(*directions)), np.dot(*directions)))


def make_parabola(before: Motion, first: Motion, second: Motion) -> FloatArray:
    """Positions (21, 3) along the corner path between two lines on a controller with zones."""
    corner, a, b = find_end(first), measure_length(before, first), measure_length(first, second)
    zone = min(first.blend, a / 2, b / 2)
    begin = corner + (find_end(before) - corner) * zone / a
    end = corner + (find_end(second) - corner) * zone / b
    t = np.linspace(0, 1, 21)[:, None]
    return np.asarray((1 - t) ** 2 * begin + 2 * t * (1 - t) * corner + t**2 * end)


def measure_distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """The distance of each of `points` (N, 3) from a polyline, mm."""
    a, d = line[:-1], np.diff(line, axis=0)
    t = np.clip(((points[:, None] - a) * d).sum(axis=2) / (d * d).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=2).min(axis=1))


def measure_rotation_error(before: Motion, first: Motion, second: Motion, distance: float) -> float:
    """Deviation of the orientation at a corner, rad, with blends from `distance` mm before it.

    At the corner, the rotation of a quarter of that distance is missing from the first motion, and
    as much of the second one is done already.
    """
    lengths = [measure_length(*pair) for pair in ((before, first), (first, second))]
    from_before = rotation_between(
        first.target.rotation, before.target.rotation, distance / 4 / lengths[0]
    )
    into_next = rotation_between(
        first.target.rotation, second.target.rotation, distance / 4 / lengths[1]
    )
    mixed = from_before @ first.target.rotation.T @ into_next @ first.target.rotation.T
    return float(np.arccos(np.clip((np.trace(mixed) - 1) / 2, -1, 1)))


def measure_length(before: Motion, motion: Motion) -> float:
    """Length of a motion, mm. The length of an arc is computed from its chord and height."""
    chord = float(np.linalg.norm(find_end(motion) - find_end(before)))
    if isinstance(motion, MoveL):
        return chord
    height = float(
        np.linalg.norm(np.array(motion.via.origin) - (find_end(before) + find_end(motion)) / 2)
    )
    radius = (chord**2 / 4 + height**2) / (2 * height)
    return 2 * radius * float(np.arctan2(chord / 2, radius - height))


def find_expected_blend(before: Motion, first: Motion, second: Motion, tolerance: float) -> float:
    """The largest blend radius that keeps `tolerance`, mm, and 0.5 deg of orientation; 0 for none.

    Any but the smallest one is at most half of a motion.
    """
    angle, half = (
        measure_corner_angle(before, first, second),
        min(measure_length(before, first), measure_length(first, second)) / 2,
    )
    for zone, distance in ZONES.items():
        fits = zone <= half or zone == min(ZONES)
        if (
            fits
            and zone * np.sin(angle / 2) / 2 <= tolerance
            and measure_rotation_error(before, first, second, distance) <= np.pi / 360
        ):
            return zone
    return 0.0


@pytest.mark.parametrize("tolerance", [0.0, 0.01, 0.02, 0.05, 0.5])
def test_blends_along_an_edge_are_as_large_as_the_tolerance_allows(
    disc: Path, tolerance: float
) -> None:
    result = build_disc(disc, tolerance={"corner": tolerance})
    rows = list_corners(result)
    assert len(rows) == 20
    (drawn,) = [path.position for path in result.tour.paths if len(path.position) > 2]
    for corner in rows:
        assert corner[1].blend == find_expected_blend(*corner, tolerance)
        if not any(isinstance(move, MoveC) for move in corner[1:]):
            assert measure_distances(make_parabola(*corner), drawn).max() <= tolerance + 1e-6
    # The sharpest corner, 11 deg, needs at least 0.3 sin(5.5 deg) / 2 = 0.0144 mm.
    assert (min(corner[1].blend for corner in rows) > 0) == (tolerance > 0.0144)


def test_the_tolerance_of_chords_is_the_default_for_corners(disc: Path) -> None:
    given, default = (
        build_disc(disc, tolerance={key: 0.02}).program.columns for key in ("corner", "chord")
    )
    assert given.blend.tolist() == default.blend.tolist()


def test_motions_before_outputs_at_the_ends_of_an_edge_stop(disc: Path) -> None:
    result = build_disc(disc, tolerance={"corner": 0.5}, process={"dwell": 0.5})
    body = [item for item in result.program.body if not isinstance(item, Comment)]
    switched = [k for k, item in enumerate(body) if isinstance(item, Output) and k]
    assert len(switched) == 2 * len(result.tour.paths) == 4
    for k in switched:
        before = body[k - 1]
        assert isinstance(before, Motion | MoveJ)
        assert before.blend == 0


def test_each_blend_saves_the_time_of_a_stop(disc: Path) -> None:
    result = build_disc(disc, tolerance={"corner": 0.5})
    blended = [motion for _, motion, _ in list_corners(result) if motion.blend > 0]
    cost = sum(motion.speed / result.cell.pace.acceleration for motion in blended)
    rows = np.flatnonzero(result.program.columns.works)
    body = list(result.program.body)
    for k in result.program.columns.at[rows].tolist():
        body[k] = replace(body[k], blend=0.0)
    with_stops = compute_cycle(
        result.program.with_body(tuple(body)), result.cell.pace, result.reach, result.cell.arm
    ).total
    assert len(blended) == 20
    assert with_stops - result.cycle.total == pytest.approx(cost, rel=0.05)


def test_the_force_is_kept_through_blends(disc: Path) -> None:
    post: dict[str, object] = {"force_load": "load"}
    result = build_disc(disc, tolerance={"corner": 0.05}, process={"force": 10.0}, post=post)
    rows = list_corners(result)
    assert len(rows) > 20  # an arc in contact becomes chords
    for _, first, second in rows:
        assert first.blend > 0
        for motion in (first, second):
            assert motion.force == 10.0
            assert motion.force_direction == pytest.approx(motion.target.rotation[:, 2], abs=1e-9)
    body = [item for item in result.program.body if not isinstance(item, Comment)]
    for k, item in enumerate(body[1:], 1):
        if isinstance(item, Force) and not isinstance(body[k - 1], Output):
            assert body[k - 1].blend == 0  # type: ignore[union-attr]
    force_lines = [line for line in result.text.splitlines() if "FCPressL " in line]
    assert sum(",z0," in line or ",z1," in line for line in force_lines) == len(force_lines) - 1
    assert ",fine," in force_lines[-1]


@pytest.mark.parametrize(
    ("post", "stop"), [("rapid", ",fine,"), ("pacscript", "@0 "), ("vplus", "BREAK")]
)
def test_the_text_of_every_controller_has_the_blends(disc: Path, post: str, stop: str) -> None:
    options: dict[str, object] = {"signals": {"process": 1}} if post == "vplus" else {}
    result = build_disc(disc, post, tolerance={"corner": 0.05}, post=options)
    assert all(motion.blend > 0 for _, motion, _ in list_corners(result))
    assert result.text.count(stop) == int((result.program.columns.blend == 0).sum())


def test_blends_keep_the_orientation_where_tilt_and_roll_change() -> None:
    rows = list_corners(build_paper_part())
    assert len(rows) == 22
    for corner in rows:
        # The rims of the bore have no corners, so that only the rotation of the tool limits blends.
        assert measure_corner_angle(*corner) < 1e-6
        fits = [
            zone
            for zone, distance in ZONES.items()
            if measure_rotation_error(*corner, distance) <= np.pi / 360 + 1e-6
        ]
        assert corner[1].blend == max(zone for zone in fits if zone <= 7.1 / 2)
    assert {corner[1].blend for corner in rows} == {0.3, 1.0}


def test_blends_are_limited_by_the_change_of_the_rotation() -> None:
    """The tool deviates by a quarter of b times the change of its rotation, rad/mm, at a corner.

    b is the distance before the corner at which it begins to rotate.
    """
    half_deg = np.pi / 360
    changes = np.array(
        [
            0.0,
            4 * half_deg / 8.01,
            4 * half_deg / 7.99,
            4 * half_deg / 0.99,
            4 * half_deg / 0.31,
            4 * half_deg / 0.29,
        ]
    )
    zones = limit_blends(np.full(6, 5.0), changes[::-1], Dynamics())
    assert zones.tolist() == [0.0, 0.3, 0.3, 1.0, 5.0, 5.0]
    # Motions that overlap have one blend radius, if the rotation changes slowly enough.
    overlapped = limit_blends(np.full(6, 0.3), changes, Dynamics(corner="overlap"))
    assert overlapped.tolist() == [0.3, 0.3, 0.3, 0.3, 0.3, 0.0]


# Clearance at corners.


def write_corner(tmp_path: Path, flat: bool) -> Path:
    """A curve with a corner of 90 deg, as points in space or as a drawing of it."""
    if not flat:
        file = tmp_path / "corner.xyz"
        file.write_text("0 0 0\n40 0 0\n40 40 0")
        return file
    file = tmp_path / "corner.dxf"
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0), (40, 0), (40, 40)])
    document.saveas(file)
    return file


def build_corner(
    tmp_path: Path, gap: float, margin: float, flat: bool = False
) -> tuple[list[float], bool]:
    """Blends of a curve with a corner of 90 deg, and whether a note reports smaller blends.

    The tolerance allows 5 mm. The square tool of 6 mm passes a block inside the corner at `gap` mm.
    """
    block = [0.0, 3.0 + gap, -5.0, 37.0 - gap, 40.0, 4.0]
    cell_table = {
        "base_from_work": [330, -20, 155, 0, 0, 0],
        "robot": "IRB 120",
        "margin": margin,
        "fixtures": [block],
    }
    job: Tables = {
        "tolerance": {"corner": 5},
        "cell": cell_table,
        "operation": {"side": "on"} if flat else {},
    }
    result = camgen.build(write_corner(tmp_path, flat), post="rapid", job=job)
    is_noted = any(
        note.what == "blends are smaller at 1 of 1 corner along paths" for note in result.notes
    )
    return [motion.blend for _, motion, _ in list_corners(result)], is_noted


def test_the_deviation_of_the_controller_limits_blends(
    disc: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller that deviates from the path by 1 m has no free corner path."""
    module = import_module("camgen.check.rounding")
    far = np.full(10_000, 1000.0)
    monkeypatch.setattr(module, "measure_rounding", lambda corners, _: far[: len(corners.blend)])
    result = build_disc(disc, tolerance={"corner": 0.5})
    assert all(corner.blend == 0 for _, corner, _ in list_corners(result))
    assert any("blends are smaller" in note.what for note in result.notes)


@pytest.mark.parametrize(
    ("gap", "margin", "blend"),
    # The corner path begins 8 mm before the corner with z5, 1.6 and 0.48 mm before with z1 and z0.
    # It deviates by sin(45 deg) / 2 of that: 2.83, 0.57 and 0.17 mm, with a reserve of up to 1.4
    # times. The rest of the gap has to be the margin.
    [
        (6.0, 2.0, 5.0),
        (6.0, 3.5, 1.0),
        (6.0, 5.0, 1.0),
        (6.0, 5.6, 0.3),
        (6.0, 5.95, 0.0),
        (1.5, 0.0, 1.0),
    ],
)
def test_a_blend_of_a_curve_keeps_the_margin(
    tmp_path: Path, gap: float, margin: float, blend: float
) -> None:
    assert build_corner(tmp_path, gap, margin) == ([blend], blend < 5.0)


@pytest.mark.parametrize(
    ("gap", "blend"),
    # The tool deviates by up to 2.83 mm with z5, 0.57 mm with z1 and 0.17 mm with z0. A reserve of
    # up to 1.4 times is added.
    [(6.0, 5.0), (2.5, 1.0), (1.5, 1.0), (0.4, 0.3), (0.1, 0.0)],
)
@pytest.mark.parametrize("margin", [0.0, 6.5])
def test_a_blend_of_a_drawing_is_free_of_collisions(
    tmp_path: Path, gap: float, blend: float, margin: float
) -> None:
    """The drawing decides how near the tool is, also within the margin."""
    assert build_corner(tmp_path, gap, margin, flat=True) == ([blend], blend < 5.0)
