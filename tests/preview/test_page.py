"""The page's data: what is drawn, when the tool is where, and that no text of an input gets out of the data."""

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
    """Two tools of 90 and 120 mm, a program for each."""
    return camgen.build(PARTS / "bracket.dxf", post="rapid", job=changing())


def changing() -> dict[str, object]:
    """A job of a robot with two operations and two tools."""
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


def data(text: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])  # type: ignore[no-any-return]


def unpack(packed: str | dict[str, str], kind: str) -> np.ndarray[Any, Any]:
    """A column of the page's data, rows of runs after each other."""
    if isinstance(packed, str):
        return np.frombuffer(base64.b64decode(packed), kind)
    counts, values = (
        np.frombuffer(base64.b64decode(packed[name]), own)
        for name, own in (("counts", "<u4"), ("values", "<i4" if packed["steps"] else kind))
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
    found = draw_spans(np.array([a]), np.array([b]), np.array([c]), 0.01)
    way = np.vstack([a, found.points])
    assert np.allclose(np.linalg.norm(way - centre, axis=1), radius, rtol=1e-7)
    assert np.allclose(found.points[-1], c)
    # Chords of at most 15 degrees are shorter than their arc by less than 0.3 %.
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert 0.997 * radius * sweep < length <= radius * sweep * (1 + 1e-9)


def test_a_contour_is_drawn_with_its_bulges_to_the_right_side() -> None:
    # Two half circles counter-clockwise about (50, 25): the first runs below the centre.
    hole = Contour(frozen([(40, 25), (60, 25)]), frozen([1, 1]), True, "L", "c1")
    square = Contour(frozen([(0, 0), (9, 0), (9, 9)]), frozen([0, 0, 0]), False, "L", "c2")
    chains = trace_contours((hole, square), 0.01)
    round_, rest = chains.points[: chains.counts[0]], chains.points[chains.counts[0] :]
    assert np.allclose(np.linalg.norm(round_[:, :2] - (50, 25), axis=1), 10)
    assert np.allclose(round_[0], round_[-1])
    assert (round_[1:3, 1] < 25).all()
    assert np.allclose(rest[:, :2], square.points)


# -- the way through time


@pytest.mark.parametrize("name", ["flat", "robot", "solid"])
def test_the_time_is_that_of_the_report(name: str, request: pytest.FixtureRequest) -> None:
    result = request.getfixturevalue(name)
    way = make_view(result).track
    assert round(float(way.time[-1]), 1) == result.report["time_s"]
    assert (np.diff(way.time) >= 0).all()
    # And so is the time that each path takes, and what is left for travel.
    spent = np.diff(way.time, prepend=0.0)
    owner = way.events.path[way.event]
    for k, path in enumerate(result.report["paths"]):
        assert spent[owner == k].sum() == pytest.approx(path["time_s"], abs=0.0051)
    assert spent[owner < 0].sum() == pytest.approx(result.report["travel_s"], abs=0.051)


def test_length_of_work_is_that_of_the_report(flat: Result) -> None:
    way = make_view(flat).track
    steps = np.linalg.norm(np.diff(way.position, axis=0), axis=1)
    work = steps[way.events.path[way.event[1:]] >= 0].sum()
    assert work == pytest.approx(sum(p["length_mm"] for p in flat.report["paths"]), rel=1e-3)  # type: ignore[attr-defined]


def test_every_path_of_a_tour_is_worked_on_in_its_order(flat: Result) -> None:
    order = [p for p in make_view(flat).track.events.path.tolist() if p >= 0]
    assert list(dict.fromkeys(order)) == list(range(len(flat.tour.paths)))


@pytest.mark.parametrize("name", ["robot", "changed"])
def test_a_robot_stands_where_the_program_is_at_the_same_time(
    name: str, request: pytest.FixtureRequest
) -> None:
    result = request.getfixturevalue(name)
    found = make_view(result)
    assert found.arm is not None
    from camgen.preview.track import compute_tool  # noqa: PLC0415 (only where there is an arm)

    assert result.reach is not None
    place, axis = compute_tool(
        result.program, found.arm.robot, found.arm.joints, result.reach.owner
    )
    # While the tool is changed the arm rests, and the tool's tip is where it was and where it is.
    rests = np.diff(found.arm.time, prepend=-1.0) == 0
    rests[:-1] |= rests[1:]
    assert rests.sum() < 10
    for k in range(3):
        shown = (
            np.interp(found.arm.time[~rests], found.track.time, way[:, k])
            for way in (found.track.position, found.track.axis)
        )
        assert next(shown) == pytest.approx(place[~rests, k], abs=0.05)
        assert next(shown) == pytest.approx(axis[~rests, k], abs=1e-3)


# -- the page


def test_same_result_same_bytes(flat: Result) -> None:
    assert format_page(make_view(flat)) == format_page(make_view(flat))


def test_columns_come_out_of_the_page_as_they_went_in(flat: Result) -> None:
    shown: View = make_view(flat)
    plain = data(format_page(shown))
    track, origin = plain["track"], plain["origin"]
    position = np.frombuffer(base64.b64decode(track["position"]), "<f4").reshape(-1, 3)  # type: ignore[index]
    assert position + origin == pytest.approx(shown.track.position, abs=1e-4)
    events = shown.track.events
    for name, kind, expected in (
        ("path", "<i4", events.path),
        ("axis", "<f4", shown.track.axis.astype("<f4").ravel()),
        ("event", "<u4", shown.track.event),
        ("instruction", "<u4", events.instruction),
        ("feed", "<f4", events.feed.astype("<f4")),
    ):
        assert unpack(track[name], kind).tolist() == expected.tolist(), name  # type: ignore[index]


def test_rows_that_come_again_and_again_take_little_of_the_page(flat: Result) -> None:
    shown: View = make_view(flat)
    many = 1000
    axis = np.tile([[0.0, 0.0, -1.0]], (many, 1))
    position = np.random.default_rng(1).normal(size=(many, 3))
    event = np.repeat(np.arange(10), 100)
    long = replace(
        shown.track, position=position, axis=axis, time=np.arange(many) / 9.0, event=event
    )
    track = data(format_page(replace(shown, track=long)))["track"]
    assert unpack(track["axis"], "<f4").reshape(-1, 3).tolist() == axis.tolist()  # type: ignore[index]
    assert unpack(track["event"], "<u4").tolist() == event.tolist()  # type: ignore[index]
    assert len(str(track["axis"])) + len(str(track["event"])) < 800  # type: ignore[index]


EVIL = "</script><script>window.bad=1</script><!--<img src=x onerror=window.bad=2>\u2028'\""


def poisoned(result: Result) -> View:
    """The view of a result whose every name is hostile."""
    part = replace(
        result.part,
        source=EVIL,
        contours=tuple(replace(c, layer=EVIL) for c in result.part.contours),
    )
    tour = replace(result.tour, paths=tuple(replace(p, layer=EVIL) for p in result.tour.paths))
    notes = (*result.notes, Note("skipped", EVIL + " c1", EVIL))
    return make_view(replace(result, part=part, tour=tour, notes=notes))


def test_no_text_of_an_input_ends_the_data_or_becomes_markup(flat: Result) -> None:
    text = format_page(poisoned(flat))
    assert text.count("<script") == 3
    assert text.count("</script") == 3
    assert "<img" not in re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert "\u2028" not in text.split('id="data">')[1].split("</script>")[0]
    assert data(text)["paths"][0]["layer"] == EVIL  # type: ignore[index]


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
    assert data(target.read_text(encoding="utf-8"))["title"] == "bracket.dxf, gcode"


def test_a_png_shows_the_part_and_the_paths_from_above(flat: Result) -> None:
    image = cv2.imdecode(np.frombuffer(draw_png(make_view(flat)), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (1200, 1600, 3)
    # The outline runs 3 mm outside the part, which is 80 x 50 mm: 86 x 56 mm fill the width between the borders. The
    # last path is orange, the sheet grey.
    orange = np.argwhere(np.abs(image.astype(int) - (30, 88, 226)).max(axis=2) < 12)
    high, wide = np.ptp(orange, axis=0)
    assert wide == pytest.approx(1600 - 120, abs=4)
    assert high / wide == pytest.approx(56 / 86, abs=0.005)
    sheet = (np.abs(image.astype(int) - (236, 229, 223)).max(axis=2) < 3).sum() * (86 / wide) ** 2
    # Area of the plate less its round corners and holes (bracket.dxf: two holes of 8 mm, a slot of 30 x 10 mm).
    area = 80 * 50 - (4 - np.pi) * 100 - 2 * np.pi * 16 - (20 * 10 + np.pi * 25)
    assert sheet == pytest.approx(area, rel=0.03)


def test_same_result_same_picture(flat: Result) -> None:
    assert draw_png(make_view(flat)) == draw_png(make_view(flat))


def test_in_a_png_what_is_left_out_is_red_and_travel_runs_through_no_words() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})
    found = make_view(result)
    # Travel all over the picture, as that of arms is.
    wild = found.track.position.copy()
    wild[0], wild[1] = (-400, -900, 0), (500, 900, 0)
    raw = draw_png(replace(found, track=replace(found.track, position=wild)))
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR).astype(int)
    blue, green, red = (image[..., k] for k in range(3))
    assert ((red > 180) & (green < 40) & (blue < 60)).sum() > 3000
    for band in (image[:100], image[-50:]):
        travel = np.abs(band - (170, 150, 138)).max(axis=2) < 4
        assert travel.sum() < 40


def test_a_long_time_is_told_in_minutes(flat: Result) -> None:
    fast = dict(make_view(flat).facts)["Time"]
    assert re.fullmatch(r"[\d.]+ s, [\d.]+ s of it travel", fast)
    slow = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"process": {"feed": 1.0}})
    assert re.match(r"\d+ min \d\d s, [\d.]+ s of it travel", dict(make_view(slow).facts)["Time"])


def test_a_picture_lies_under_its_paths_and_has_no_layers() -> None:
    job = {"operation": {"kind": "follow"}, "image": {"mm_per_px": 0.1}}
    result = camgen.build(PARTS / "gear.png", post="gcode", job=job)
    found = make_view(result)
    assert (
        {row.layer for row in found.rows}
        == {line.layer for line in found.lines if line.state == "done"}
        == {""}
    )
    assert found.photo is not None
    raster = result.part.raster
    assert raster is not None
    shown = cv2.imdecode(np.frombuffer(found.photo.image, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert max(shown.shape) <= 1600
    assert shown.shape[1] / shown.shape[0] == pytest.approx(
        raster.view.shape[1] / raster.view.shape[0], rel=2e-3
    )
    # Corners are half a pixel outside the centres of the first and the last one.
    first, last = found.photo.corners[0], found.photo.corners[2]
    centres = (
        raster.work_from_view
        @ np.array([(0, 0, 1), (raster.view.shape[1] - 1, raster.view.shape[0] - 1, 1)]).T
    )
    assert first == pytest.approx(centres[:, 0] + (-0.05, 0.05))
    assert last == pytest.approx(centres[:, 1] + (0.05, -0.05))
    plain = data(format_page(found))
    assert plain["photo"]["address"].startswith("data:image/jpeg;base64,")  # type: ignore[index]
    assert "photo" not in data(
        format_page(make_view(camgen.build(PARTS / "bracket.dxf", post="gcode")))
    )


def test_links_of_a_urdf_that_are_meshes_are_drawn_by_them() -> None:
    file = PARTS.parent / "robots" / "six.urdf"
    frames = {"base_from_work": [300, -60, -50, 0, 0, 0], "flange_from_tool": [0, 0, 100, 0, 0, 0]}
    cell = {"robot": str(file), **frames, "home": [0, -100, 0, 0, 30, 0]}
    links = data(
        format_page(
            make_view(camgen.build(PARTS / "bracket.dxf", post="rapid", job={"cell": cell}))
        )
    )["arm"]["links"]  # type: ignore[index]
    meshes = {name: mesh for name, _, mesh in links if mesh}
    assert set(meshes) == {"link_1", "link_2"}
    # As large as the cuboids that were found around it.
    (pose, half), *_ = next(boxes for name, boxes, _ in links if name == "link_2")
    points = np.frombuffer(base64.b64decode(meshes["link_2"]["vertices"]), "<f4").reshape(-1, 3)
    turn, middle = np.array(pose[:9]).reshape(3, 3), np.array(pose[9:])
    own = (points - middle) @ turn
    assert np.abs(own).max(axis=0) == pytest.approx(half, abs=1e-3)


def test_a_mesh_of_too_many_triangles_becomes_coarser_and_keeps_its_size() -> None:
    turn = np.linspace(0, 2 * np.pi, 161)[:-1]
    height = np.linspace(-50, 50, 120)
    around, up = np.meshgrid(turn, height)
    points = np.column_stack([40 * np.cos(around.ravel()), 40 * np.sin(around.ravel()), up.ravel()])
    k = np.arange(119 * 160)
    right = k // 160 * 160 + (k + 1) % 160
    faces = np.concatenate(
        [np.column_stack([k, right, k + 160]), np.column_stack([right, right + 160, k + 160])]
    )
    found = merge_surfaces([Surface(points, faces)])
    assert found is not None
    vertices, coarse = found
    assert 500 < len(coarse) <= MOST_FACES < len(faces)
    assert coarse.max() == len(vertices) - 1
    assert np.ptp(vertices, axis=0) == pytest.approx((80, 80, 100), abs=4)
    assert np.hypot(*vertices[:, :2].T) == pytest.approx(np.full(len(vertices), 40), abs=1)
    assert merge_surfaces([]) is None
