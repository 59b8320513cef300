"""The data of the page: curves, the pose of the tool at each time, and texts of hostile inputs."""

import base64
import json
import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

import camgen
from camgen.geometry.arcs import compute_circle
from camgen.model.part import Contour, Note
from camgen.model.pose import frozen
from camgen.pipeline import Result
from camgen.preview.curves import draw_spans, trace_contours
from camgen.preview.meshes import MOST_FACES, merge_surfaces
from camgen.preview.page import format_page
from camgen.preview.png import draw_png
from camgen.preview.view import View, make_view
from camgen.robots.models import Surface

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ROBOT = {"cell": {"robot": "IRB 2400", "base_from_work": [1000, 0, 400, 0, 0, 0]}}


@pytest.fixture(scope="module")
def flat() -> Result:
    return camgen.build(PARTS / "bracket.dxf", post="gcode")


@pytest.fixture(scope="module")
def robot() -> Result:
    return camgen.build(PARTS / "bracket.dxf", post="rapid", job=ROBOT)


@pytest.fixture(scope="module")
def changed() -> Result:
    """A result with two tools of 90 and 120 mm length, and one program for each tool."""
    return camgen.build(PARTS / "bracket.dxf", post="rapid", job=make_job_of_two_tools())


def make_job_of_two_tools() -> dict[str, object]:
    """A job for a robot with two operations and two tools."""
    tools = [
        {
            "name": "drill",
            "number": 1,
            "kind": "drill",
            "diameter": 5.0,
            "length": 120.0,
            "speed": 3000.0,
        },
        {"name": "mill", "number": 2, "diameter": 6.0, "length": 90.0, "speed": 9000.0},
    ]
    rows = [
        {"kind": "drill", "tool": "drill", "depth": 7.0, "holes": [7.9, 8.1]},
        {"kind": "follow", "tool": "mill", "nesting": "outer", "depth": 6.0, "passes": 2},
    ]
    return ROBOT | {
        "tools": tools,
        "operations": rows,
        "post": {"signals": {"spindle": "aoSpindle"}},
    }


def read_data(text: str) -> dict[str, Any]:
    """The data that a page holds as JSON."""
    match = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert match
    return json.loads(match[1])


def unpack(packed: str | dict[str, str], kind: str) -> np.ndarray[Any, Any]:
    """A column of the page's data. A packed column holds each run of equal rows (or steps) once."""
    if isinstance(packed, str):
        return np.frombuffer(base64.b64decode(packed), kind)
    counts, values = (
        np.frombuffer(base64.b64decode(packed[name]), column_kind)
        for name, column_kind in (("counts", "<u4"), ("values", "<i4" if packed["steps"] else kind))
    )
    rows = np.repeat(values.reshape(len(counts), -1), counts, axis=0)
    return (np.cumsum(rows) if packed["steps"] else rows.ravel()).astype(kind)


# -- curves

coordinate = st.floats(-100, 100)
point = st.tuples(coordinate, coordinate, coordinate)


@given(point, point, point)
def test_points_of_an_arc_lie_on_its_circle_and_cover_its_length(
    a: tuple[float, float, float], b: tuple[float, float, float], c: tuple[float, float, float]
) -> None:
    sides = sorted([math.dist(a, b), math.dist(b, c), math.dist(a, c)])
    if sides[0] < 1.0 or sides[0] + sides[1] - sides[2] < 0.1:
        return
    centre, radius, _, sweep = compute_circle(a, b, c)
    chain = draw_spans(np.array([a]), np.array([b]), np.array([c]), 0.01)
    points = np.vstack([a, chain.points])
    assert np.allclose(np.linalg.norm(points - centre, axis=1), radius, rtol=1e-7)
    assert np.allclose(chain.points[-1], c)
    # Chords of at most 15 degrees are shorter than their arc by less than 0.3 %.
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert 0.997 * radius * sweep < length <= radius * sweep * (1 + 1e-9)


def test_the_arcs_of_a_contour_bulge_to_their_side() -> None:
    # Two half circles counter-clockwise about (50, 25): the first runs below the centre.
    hole = Contour(frozen([(40, 25), (60, 25)]), frozen([1, 1]), True, "L", "c1")
    square = Contour(frozen([(0, 0), (9, 0), (9, 9)]), frozen([0, 0, 0]), False, "L", "c2")
    chains = trace_contours((hole, square), 0.01)
    circle, open_chain = chains.points[: chains.counts[0]], chains.points[chains.counts[0] :]
    assert np.allclose(np.linalg.norm(circle[:, :2] - (50, 25), axis=1), 10)
    assert np.allclose(circle[0], circle[-1])
    assert (circle[1:3, 1] < 25).all()
    assert np.allclose(open_chain[:, :2], square.points)


# -- the track: pose and time


@pytest.mark.parametrize("name", ["flat", "robot", "solid"])
def test_the_time_is_that_of_the_report(name: str, request: pytest.FixtureRequest) -> None:
    result = request.getfixturevalue(name)
    track = make_view(result).track
    assert round(float(track.time[-1]), 1) == result.report["time_s"]
    assert (np.diff(track.time) >= 0).all()
    # The times of the paths and of travel are those of the report, too.
    spent = np.diff(track.time, prepend=0.0)
    owner = track.events.path[track.event]
    for k, path in enumerate(result.report["paths"]):
        assert spent[owner == k].sum() == pytest.approx(path["time_s"], abs=0.0051)
    assert spent[owner < 0].sum() == pytest.approx(result.report["travel_s"], abs=0.051)


def test_length_of_work_is_that_of_the_report(flat: Result) -> None:
    track = make_view(flat).track
    steps = np.linalg.norm(np.diff(track.position, axis=0), axis=1)
    work = steps[track.events.path[track.event[1:]] >= 0].sum()
    lengths = [path["length_mm"] for path in flat.report["paths"]]
    assert work == pytest.approx(sum(lengths), rel=1e-3)


def test_the_track_runs_the_paths_in_the_order_of_the_tour(flat: Result) -> None:
    order = [p for p in make_view(flat).track.events.path.tolist() if p >= 0]
    assert list(dict.fromkeys(order)) == list(range(len(flat.tour.paths)))


@pytest.mark.parametrize("name", ["robot", "changed"])
def test_the_tool_of_the_arm_is_at_the_pose_of_the_program_at_each_time(
    name: str, request: pytest.FixtureRequest
) -> None:
    result = request.getfixturevalue(name)
    view = make_view(result)
    assert view.arm is not None
    from camgen.preview.track import compute_tool  # noqa: PLC0415 (only where there is an arm)

    assert result.reach is not None
    position, axis = compute_tool(
        result.program, view.arm.robot, view.arm.joints, result.reach.owner
    )
    # At a tool change the arm rests, and the TCP jumps to the other tool: two poses at one time.
    rests = np.diff(view.arm.time, prepend=-1.0) == 0
    rests[:-1] |= rests[1:]
    assert rests.sum() < 10
    for k in range(3):
        shown = (
            np.interp(view.arm.time[~rests], view.track.time, column[:, k])
            for column in (view.track.position, view.track.axis)
        )
        assert next(shown) == pytest.approx(position[~rests, k], abs=0.05)
        assert next(shown) == pytest.approx(axis[~rests, k], abs=1e-3)


# -- the page


def test_the_same_result_makes_the_same_page(flat: Result) -> None:
    assert format_page(make_view(flat)) == format_page(make_view(flat))


def test_columns_are_read_from_the_page_unchanged(flat: Result) -> None:
    view: View = make_view(flat)
    plain = read_data(format_page(view))
    track, origin = plain["track"], plain["origin"]
    packed = base64.b64decode(track["position"])
    position = np.frombuffer(packed, "<f4").reshape(-1, 3)
    assert position + origin == pytest.approx(view.track.position, abs=1e-4)
    events = view.track.events
    for name, kind, expected in (
        ("path", "<i4", events.path),
        ("axis", "<f4", view.track.axis.astype("<f4").ravel()),
        ("event", "<u4", view.track.event),
        ("instruction", "<u4", events.instruction),
        ("feed", "<f4", events.feed.astype("<f4")),
    ):
        assert unpack(track[name], kind).tolist() == expected.tolist(), name


def test_repeated_rows_of_a_column_take_little_of_the_page(flat: Result) -> None:
    view: View = make_view(flat)
    count = 1000
    axis = np.tile([[0.0, 0.0, -1.0]], (count, 1))
    position = np.random.default_rng(1).normal(size=(count, 3))
    event = np.repeat(np.arange(10), 100)
    long = replace(
        view.track, position=position, axis=axis, time=np.arange(count) / 9.0, event=event
    )
    track = read_data(format_page(replace(view, track=long)))["track"]
    assert unpack(track["axis"], "<f4").reshape(-1, 3).tolist() == axis.tolist()
    assert unpack(track["event"], "<u4").tolist() == event.tolist()
    assert len(str(track["axis"])) + len(str(track["event"])) < 800


EVIL = "</script><script>window.bad=1</script><!--<img src=x onerror=window.bad=2>\u2028'\""


def make_hostile_view(result: Result) -> View:
    """The view of a result in which all names are markup."""
    part = replace(
        result.part,
        source=EVIL,
        contours=tuple(replace(c, layer=EVIL) for c in result.part.contours),
    )
    tour = replace(result.tour, paths=tuple(replace(p, layer=EVIL) for p in result.tour.paths))
    notes = (*result.notes, Note("skipped", EVIL + " c1", EVIL))
    return make_view(replace(result, part=part, tour=tour, notes=notes))


def test_no_text_of_an_input_ends_the_data_or_becomes_markup(flat: Result) -> None:
    text = format_page(make_hostile_view(flat))
    assert text.count("<script") == 3
    assert text.count("</script") == 3
    assert "<img" not in re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert "\u2028" not in text.split('id="data">')[1].split("</script>")[0]
    assert read_data(text)["paths"][0]["layer"] == EVIL


def test_the_page_allows_no_network_and_only_its_own_scripts(flat: Result) -> None:
    text = format_page(make_view(flat))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy
    assert policy[1].startswith("default-src 'none'")
    assert "unsafe" not in policy[1]
    assert not re.search(r'(src|href)="(?!data:)', text.split("<script")[0])


def test_the_command_line_writes_the_page(tmp_path: Path) -> None:
    from camgen.cli import main  # noqa: PLC0415 (as the command line loads it)

    target = tmp_path / "a.html"
    assert (
        main(
            [
                "build",
                str(PARTS / "bracket.dxf"),
                "--post",
                "gcode",
                "-o",
                str(tmp_path),
                "--preview",
                str(target),
                "-q",
            ]
        )
        == 0
    )
    assert read_data(target.read_text(encoding="utf-8"))["title"] == "bracket.dxf, gcode"


def test_a_png_shows_the_part_and_the_paths_from_above(flat: Result) -> None:
    image = cv2.imdecode(np.frombuffer(draw_png(make_view(flat)), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (1200, 1600, 3)
    # The outline runs 3 mm outside of the part of 80 x 50 mm: 86 x 56 mm fill the width between the
    # borders. The last path is orange, the sheet grey.
    orange = np.argwhere(np.abs(image.astype(int) - (30, 88, 226)).max(axis=2) < 12)
    height_px, width_px = np.ptp(orange, axis=0)
    assert width_px == pytest.approx(1600 - 120, abs=4)
    assert height_px / width_px == pytest.approx(56 / 86, abs=0.005)
    sheet = (np.abs(image.astype(int) - (236, 229, 223)).max(axis=2) < 3).sum() * (
        86 / width_px
    ) ** 2
    # Area of the plate without its round corners, two holes of 8 mm, and a slot of 30 x 10 mm.
    area = 80 * 50 - (4 - np.pi) * 100 - 2 * np.pi * 16 - (20 * 10 + np.pi * 25)
    assert sheet == pytest.approx(area, rel=0.03)


def test_the_same_result_makes_the_same_picture(flat: Result) -> None:
    assert draw_png(make_view(flat)) == draw_png(make_view(flat))


def test_a_png_shows_skipped_contours_in_red_and_no_travel_over_its_text() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})
    view = make_view(result)
    # Travel that crosses the whole picture, as the travel of an arm may.
    position = view.track.position.copy()
    position[0], position[1] = (-400, -900, 0), (500, 900, 0)
    raw = draw_png(replace(view, track=replace(view.track, position=position)))
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR).astype(int)
    blue, green, red = (image[..., k] for k in range(3))
    assert ((red > 180) & (green < 40) & (blue < 60)).sum() > 3000
    for band in (image[:100], image[-50:]):
        travel = np.abs(band - (170, 150, 138)).max(axis=2) < 4
        assert travel.sum() < 40


def test_a_long_time_is_given_in_minutes(flat: Result) -> None:
    fast = dict(make_view(flat).facts)["Time"]
    assert re.fullmatch(r"[\d.]+ s, [\d.]+ s of it travel", fast)
    slow = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"process": {"feed": 1.0}})
    assert re.match(r"\d+ min \d\d s, [\d.]+ s of it travel", dict(make_view(slow).facts)["Time"])


def test_a_picture_is_drawn_under_its_paths_which_have_no_layers() -> None:
    job = {"operation": {"kind": "follow"}, "image": {"mm_per_px": 0.1}}
    result = camgen.build(PARTS / "gear.png", post="gcode", job=job)
    view = make_view(result)
    assert (
        {row.layer for row in view.rows}
        == {line.layer for line in view.lines if line.state == "done"}
        == {""}
    )
    assert view.photo is not None
    raster = result.part.raster
    assert raster is not None
    image = cv2.imdecode(np.frombuffer(view.photo.image, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert max(image.shape) <= 1600
    assert image.shape[1] / image.shape[0] == pytest.approx(
        raster.view.shape[1] / raster.view.shape[0], rel=2e-3
    )
    # The corners lie half a pixel outside of the centres of the first and the last pixel.
    first, last = view.photo.corners[0], view.photo.corners[2]
    centres = (
        raster.work_from_view
        @ np.array([(0, 0, 1), (raster.view.shape[1] - 1, raster.view.shape[0] - 1, 1)]).T
    )
    assert first == pytest.approx(centres[:, 0] + (-0.05, 0.05))
    assert last == pytest.approx(centres[:, 1] + (0.05, -0.05))
    plain = read_data(format_page(view))
    assert plain["photo"]["address"].startswith("data:image/jpeg;base64,")
    assert "photo" not in read_data(
        format_page(make_view(camgen.build(PARTS / "bracket.dxf", post="gcode")))
    )


def test_links_of_a_urdf_with_meshes_are_drawn_by_these_meshes() -> None:
    file = PARTS.parent / "robots" / "six.urdf"
    frames = {"base_from_work": [300, -60, -50, 0, 0, 0], "flange_from_tool": [0, 0, 100, 0, 0, 0]}
    cell = {"robot": str(file), **frames, "home": [0, -100, 0, 0, 30, 0]}
    links = read_data(
        format_page(
            make_view(camgen.build(PARTS / "bracket.dxf", post="rapid", job={"cell": cell}))
        )
    )["arm"]["links"]
    meshes = {name: mesh for name, _, mesh in links if mesh}
    assert set(meshes) == {"link_1", "link_2"}
    # The mesh is as large as the cuboid around it.
    (pose, half), *_ = next(boxes for name, boxes, _ in links if name == "link_2")
    points = np.frombuffer(base64.b64decode(meshes["link_2"]["vertices"]), "<f4").reshape(-1, 3)
    rotation, middle = np.array(pose[:9]).reshape(3, 3), np.array(pose[9:])
    points_in_box = (points - middle) @ rotation
    assert np.abs(points_in_box).max(axis=0) == pytest.approx(half, abs=1e-3)


def test_a_mesh_of_too_many_triangles_is_simplified_and_keeps_its_size() -> None:
    angle = np.linspace(0, 2 * np.pi, 161)[:-1]
    height = np.linspace(-50, 50, 120)
    around, up = np.meshgrid(angle, height)
    points = np.column_stack([40 * np.cos(around.ravel()), 40 * np.sin(around.ravel()), up.ravel()])
    k = np.arange(119 * 160)
    right = k // 160 * 160 + (k + 1) % 160
    faces = np.concatenate(
        [np.column_stack([k, right, k + 160]), np.column_stack([right, right + 160, k + 160])]
    )
    merged = merge_surfaces([Surface(points, faces)])
    assert merged is not None
    vertices, coarse = merged
    assert 500 < len(coarse) <= MOST_FACES < len(faces)
    assert coarse.max() == len(vertices) - 1
    assert np.ptp(vertices, axis=0) == pytest.approx((80, 80, 100), abs=4)
    assert np.hypot(*vertices[:, :2].T) == pytest.approx(np.full(len(vertices), 40), abs=1)
    assert merge_surfaces([]) is None
