"""Rows of an edge without stops: how near the rounded way is to the drawn one, what is free there, what it saves."""

from functools import cache
from importlib import import_module
from itertools import pairwise
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
#: Zones, and from where on the tool is turned with each of them: z5, z1 and z0 of RAPID, mm.
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
    """A plate of 10 mm, half an ellipse of 60 x 20 mm with 24 sides: its upper edges are a polyline and a line."""
    t = np.linspace(0.0, np.pi, 25)
    ring = np.column_stack([30 + 30 * np.cos(t), 20 * np.sin(t)]).tolist()
    corners = [(*p, z) for z in (0.0, 10.0) for p in (*ring, (30.0, 10.0))]
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


def build(disc: Path, controller: str = "rapid", **tables: dict[str, object]) -> Result:
    """The upper edges of the disc."""
    job: Tables = {
        "input": {"select": "e1, e2"},
        "operation": {"offset": 2},
        "tool": TOOL,
        "cell": CELL,
        **tables,
    }
    return camgen.build(disc, post=controller, job=job)


@cache
def of_the_paper() -> Result:
    """The first part of the paper, with rims along which tilt and roll of the tool change from row to row."""
    tables = make_job(mesh.read(source(PARTS / "rfa1.stl")), "IRB 2400")
    return camgen.build(
        PARTS / "rfa1.stl", post="rapid", job={**tables, "tool": {**tables["tool"], **FREE}}
    )


def inner(result: Result) -> list[tuple[Motion, Motion, Motion]]:
    """Each corner between two motions along one edge, with the motion that ends where the first one begins."""
    moves = result.program.columns.moves
    return [
        (moves[k - 1], one, two)
        for k, (one, two) in enumerate(pairwise(moves))
        if isinstance(one, Motion)
        and isinstance(two, Motion)
        and one.work
        and two.work
        and one.path == two.path
    ]


def point(move: Motion) -> FloatArray:
    return np.array(move.target.origin)


def turn(before: Motion, one: Motion, two: Motion) -> float:
    """The angle of a corner. The tangent at an end of an arc is its chord, mirrored at the chord of the half there."""
    directions = []
    for start, move, at_end in ((before, one, True), (one, two, False)):
        chord = point(move) - point(start)
        if isinstance(move, MoveC):
            via = np.array(move.via.origin)
            half = point(move) - via if at_end else via - point(start)
            chord = 2 * half * (half @ chord) / (half @ half) - chord
        directions.append(chord)
    return float(np.arctan2(np.linalg.norm(np.cross(*directions)), np.dot(*directions)))


def parabola(before: Motion, one: Motion, two: Motion) -> FloatArray:
    """The way about a corner between two lines (21, 3), as a controller with zones rounds it."""
    corner, a, b = point(one), length_of(before, one), length_of(one, two)
    zone = min(one.blend, a / 2, b / 2)
    begin, end = (
        corner + (point(before) - corner) * zone / a,
        corner + (point(two) - corner) * zone / b,
    )
    t = np.linspace(0, 1, 21)[:, None]
    return np.asarray((1 - t) ** 2 * begin + 2 * t * (1 - t) * corner + t**2 * end)


def distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """From each of ``points`` to a polyline."""
    a, d = line[:-1], np.diff(line, axis=0)
    t = np.clip(((points[:, None] - a) * d).sum(axis=2) / (d * d).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=2).min(axis=1))


def swerve(before: Motion, one: Motion, two: Motion, reach: float) -> float:
    """Rad by which the tool is off its orientation at a corner when it begins to turn ``reach`` mm before it: there
    a quarter of that is left of the turn before, and as much made of the next one.
    """
    lengths = [length_of(*pair) for pair in ((before, one), (one, two))]
    left = rotation_between(one.target.rotation, before.target.rotation, reach / 4 / lengths[0])
    made = rotation_between(one.target.rotation, two.target.rotation, reach / 4 / lengths[1])
    mixed = left @ one.target.rotation.T @ made @ one.target.rotation.T
    return float(np.arccos(np.clip((np.trace(mixed) - 1) / 2, -1, 1)))


def length_of(one: Motion, two: Motion) -> float:
    """Mm of the second motion; an arc by its chord and height."""
    chord = float(np.linalg.norm(point(two) - point(one)))
    if isinstance(two, MoveL):
        return chord
    height = float(np.linalg.norm(np.array(two.via.origin) - (point(one) + point(two)) / 2))
    radius = (chord**2 / 4 + height**2) / (2 * height)
    return 2 * radius * float(np.arctan2(chord / 2, radius - height))


def wanted(before: Motion, one: Motion, two: Motion, tolerance: float) -> float:
    """The largest zone with which a corner is left by no more than ``tolerance``, and the tool's orientation by no more
    than half a degree; none but the least is more than half of a motion.
    """
    angle, half = turn(before, one, two), min(length_of(before, one), length_of(one, two)) / 2
    for zone, begin in ZONES.items():
        fits = zone <= half or zone == min(ZONES)
        if (
            fits
            and zone * np.sin(angle / 2) / 2 <= tolerance
            and swerve(before, one, two, begin) <= np.pi / 360
        ):
            return zone
    return 0.0


@pytest.mark.parametrize("tolerance", [0.0, 0.01, 0.02, 0.05, 0.5])
def test_the_rows_of_an_edge_are_passed_as_near_as_the_tolerance_asks(
    disc: Path, tolerance: float
) -> None:
    result = build(disc, tolerance={"corner": tolerance})
    rows = inner(result)
    assert len(rows) == 20
    (drawn,) = [path.position for path in result.tour.paths if len(path.position) > 2]
    for corner in rows:
        assert corner[1].blend == wanted(*corner, tolerance)
        if not any(isinstance(move, MoveC) for move in corner[1:]):
            assert distances(parabola(*corner), drawn).max() <= tolerance + 1e-6
    # A corner of 11 deg, the sharpest, asks for 0.3 sin(5.5 deg) / 2 = 0.0144 mm at the least.
    assert (min(corner[1].blend for corner in rows) > 0) == (tolerance > 0.0144)


def test_it_is_the_tolerance_of_chords_where_none_is_given(disc: Path) -> None:
    given, taken = (
        build(disc, tolerance={key: 0.02}).program.columns for key in ("corner", "chord")
    )
    assert given.blend.tolist() == taken.blend.tolist()


def test_the_ends_of_an_edge_and_what_is_switched_there_are_stops(disc: Path) -> None:
    result = build(disc, tolerance={"corner": 0.5}, process={"dwell": 0.5})
    body = [item for item in result.program.body if not isinstance(item, Comment)]
    switched = [k for k, item in enumerate(body) if isinstance(item, Output) and k]
    assert len(switched) == 2 * len(result.tour.paths) == 4
    for k in switched:
        before = body[k - 1]
        assert isinstance(before, Motion | MoveJ)
        assert before.blend == 0


def test_each_stop_that_is_left_out_saves_what_braking_and_speeding_up_cost(disc: Path) -> None:
    result = build(disc, tolerance={"corner": 0.5})
    passed = [one for _, one, _ in inner(result) if one.blend > 0]
    cost = sum(one.speed / result.cell.pace.acceleration for one in passed)
    rows = np.flatnonzero(result.program.columns.works)
    body = list(result.program.body)
    for k in result.program.columns.at[rows].tolist():
        body[k] = replace(body[k], blend=0.0)
    at_rows = compute_cycle(
        result.program.with_body(tuple(body)), result.cell.pace, result.reach, result.cell.arm
    ).total
    assert len(passed) == 20
    assert at_rows - result.cycle.total == pytest.approx(cost, rel=0.05)


def test_a_force_presses_on_from_row_to_row(disc: Path) -> None:
    post: dict[str, object] = {"force_load": "load"}
    result = build(disc, tolerance={"corner": 0.05}, process={"force": 10.0}, post=post)
    rows = inner(result)
    assert len(rows) > 20  # the arc is chords
    for _, one, two in rows:
        assert one.blend > 0
        for move in (one, two):
            assert move.force == 10.0
            assert move.force_direction == pytest.approx(move.target.rotation[:, 2], abs=1e-9)
    body = [item for item in result.program.body if not isinstance(item, Comment)]
    for k, item in enumerate(body[1:], 1):
        if isinstance(item, Force) and not isinstance(body[k - 1], Output):
            assert body[k - 1].blend == 0  # type: ignore[union-attr]
    pressed = [line for line in result.text.splitlines() if "FCPressL " in line]
    assert sum(",z0," in line or ",z1," in line for line in pressed) == len(pressed) - 1
    assert ",fine," in pressed[-1]


@pytest.mark.parametrize(
    ("post", "stop"), [("rapid", ",fine,"), ("pacscript", "@0 "), ("vplus", "BREAK")]
)
def test_the_text_of_every_controller_passes_the_rows(disc: Path, post: str, stop: str) -> None:
    options: dict[str, object] = {"signals": {"process": 1}} if post == "vplus" else {}
    result = build(disc, post, tolerance={"corner": 0.05}, post=options)
    assert all(one.blend > 0 for _, one, _ in inner(result))
    assert result.text.count(stop) == int((result.program.columns.blend == 0).sum())


def test_where_the_tool_is_turned_otherwise_from_row_to_row_it_may_hardly_be_off() -> None:
    rows = inner(of_the_paper())
    assert len(rows) == 22
    for corner in rows:
        # The rims of the bore go on without a corner, so that only the tool's turning asks for less.
        assert turn(*corner) < 1e-6
        fits = [
            zone for zone, begin in ZONES.items() if swerve(*corner, begin) <= np.pi / 360 + 1e-6
        ]
        assert corner[1].blend == max(zone for zone in fits if zone <= 7.1 / 2)
    assert {corner[1].blend for corner in rows} == {0.3, 1.0}


def test_a_tool_that_turns_otherwise_all_at_once_stops() -> None:
    """Begun b before the corner the tool is off by a quarter of b times what its turning changes there, rad/mm."""
    half = np.pi / 360
    bend = np.array(
        [0.0, 4 * half / 8.01, 4 * half / 7.99, 4 * half / 0.99, 4 * half / 0.31, 4 * half / 0.29]
    )
    zones = limit_blends(np.full(6, 5.0), bend[::-1], Dynamics())
    assert zones.tolist() == [0.0, 0.3, 0.3, 1.0, 5.0, 5.0]
    # Where motions overlap there is one rounding, as long as they are fast.
    lapped = limit_blends(np.full(6, 0.3), bend, Dynamics(corner="overlap"))
    assert lapped.tolist() == [0.3, 0.3, 0.3, 0.3, 0.3, 0.0]


# What is free.


def corner_of(tmp_path: Path, flat: bool) -> Path:
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


def angle_iron(
    tmp_path: Path, gap: float, margin: float, flat: bool = False
) -> tuple[list[float], bool]:
    """The blends of a curve with a corner of 90 deg, which may be rounded by 5 mm, about a block that the square tool
    of 6 mm passes at ``gap`` mm, and whether a note tells that they are less than asked.
    """
    block = [0.0, 3.0 + gap, -5.0, 37.0 - gap, 40.0, 4.0]
    fixed = {
        "base_from_work": [330, -20, 155, 0, 0, 0],
        "robot": "IRB 120",
        "margin": margin,
        "fixtures": [block],
    }
    job: Tables = {
        "tolerance": {"corner": 5},
        "cell": fixed,
        "operation": {"side": "on"} if flat else {},
    }
    result = camgen.build(corner_of(tmp_path, flat), post="rapid", job=job)
    told = any(
        note.what == "blends are smaller at 1 of 1 corner along paths" for note in result.notes
    )
    return [one.blend for _, one, _ in inner(result)], told


def test_what_the_model_rounds_more_counts_for_the_margin(
    disc: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller that leaves the path by a metre has no room in any corner."""
    module = import_module("camgen.check.rounding")
    far = np.full(10_000, 1000.0)
    monkeypatch.setattr(module, "measure_rounding", lambda corners, _: far[: len(corners.blend)])
    result = build(disc, tolerance={"corner": 0.5})
    assert all(corner.blend == 0 for _, corner, _ in inner(result))
    assert any("blends are smaller" in note.what for note in result.notes)


@pytest.mark.parametrize(
    ("gap", "margin", "blend"),
    # The tool begins to turn 8 mm before its corner with zone 5, 1.6 and 0.48 mm with the others, which has it off its
    # way by sin(45 deg) / 2 of that: 2.83, 0.57 and 0.17 mm, taken up to 1.4 times as large. The rest of the gap is to
    # be the margin.
    [
        (6.0, 2.0, 5.0),
        (6.0, 3.5, 1.0),
        (6.0, 5.0, 1.0),
        (6.0, 5.6, 0.3),
        (6.0, 5.95, 0.0),
        (1.5, 0.0, 1.0),
    ],
)
def test_a_corner_is_rounded_as_far_as_the_margin_is_kept(
    tmp_path: Path, gap: float, margin: float, blend: float
) -> None:
    assert angle_iron(tmp_path, gap, margin) == ([blend], blend < 5.0)


@pytest.mark.parametrize(
    ("gap", "blend"),
    # Zone 5 has the tool up to 2.83 mm off its way, taken up to 1.4 times as large, 1 mm up to 0.57 mm, 0.3 mm 0.17.
    [(6.0, 5.0), (2.5, 1.0), (1.5, 1.0), (0.4, 0.3), (0.1, 0.0)],
)
@pytest.mark.parametrize("margin", [0.0, 6.5])
def test_a_corner_of_a_drawing_is_rounded_as_far_as_it_meets_nothing(
    tmp_path: Path, gap: float, blend: float, margin: float
) -> None:
    """The tool is where the drawing has it, nearer than the margin or not, which is told."""
    assert angle_iron(tmp_path, gap, margin, flat=True) == ([blend], blend < 5.0)
