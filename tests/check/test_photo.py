"""Photos compared with drawings: rendered parts have burrs and gaps of known sizes."""

import json
import math
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from bench.render.parts import bracket
from bench.render.shapes import Loop, box, circle, hole, rounded
from camgen import build
from camgen.check.photo import Inspection, inspect_photo, list_rework, registration
from camgen.check.photo.expected import expect
from camgen.check.photo.kinds import BURR_HEIGHT
from camgen.check.photo.registration import Fit
from camgen.check.photo.rework import (
    check_pose,
    is_clear,
    is_in_the_way,
    plan_passes,
    stays_down,
)
from camgen.cli import main
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import ImageTable, Job, OperationTable, ProcessTable, ToolTable
from camgen.model.pose import Pose
from camgen.model.program import MoveJ, MoveL
from camgen.read.files import Files
from camgen.read.image import read_outlines
from camgen.read.job_file import from_mapping, load_job
from tests.support.part_photos import MIDDLE, PIXEL, PLATE, bumped, drawing, photo, write_dxf

#: The job of a rendered photo.
PHOTO_JOB = Job(image=ImageTable(mm_per_px=PIXEL))


@pytest.fixture
def few_rotations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try a third of the rotations, in tests of other things."""
    monkeypatch.setattr(registration, "_TURNS", 12)


def inspect_parts(
    folder: Path, loops: Sequence[Loop], drawn: Sequence[Loop] = PLATE, turn: float = 0.0
) -> Inspection:
    """Render a photo of parts, rotated by `turn` rad, and compare it with a drawing."""
    files = Files()
    outlines = read_outlines(files.read(photo(folder / "photo.png", loops, turn)), PHOTO_JOB, files)
    return inspect_photo(outlines, drawing(drawn), Job())


@pytest.fixture(scope="module")
def burred(tmp_path_factory: pytest.TempPathFactory) -> Inspection:
    """A plate with a burr, 5 mm wide and 0.8 mm high, on the side at y = -20."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registration, "_TURNS", 12)
        loops = (bumped(PLATE[0], 0, 10, 5, 0.8), PLATE[1])
        return inspect_parts(tmp_path_factory.mktemp("burred"), loops)


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.5])
def test_a_part_as_drawn_has_no_difference(tmp_path: Path, turn: float) -> None:
    inspection = inspect_parts(tmp_path, PLATE, turn=turn)
    assert inspection.differences == ()
    assert np.angle(np.exp(1j * (inspection.fit.turn + turn))) == pytest.approx(0, abs=2e-4)
    # The middle of the picture is the origin of the drawing.
    assert inspection.fit.apply(np.array([[MIDDLE.real, MIDDLE.imag]]))[0] == pytest.approx(
        [0, 0], abs=PIXEL / 2 + 0.02
    )
    assert inspection.fit.rms < 0.1 * PIXEL


@pytest.mark.usefixtures("few_rotations")
def test_burrs_and_dents_are_measured(tmp_path: Path) -> None:
    outline = bumped(bumped(bumped(PLATE[0], 0, 10, 5, 0.8), 0, 6, 2, 0.3), 0, 40, 4, 0)
    outline = bumped(outline, len(outline.points) - 2, 25, 4, -0.5)
    inspection = inspect_parts(tmp_path, (outline, PLATE[1]), turn=0.7)
    high, dent, low = inspection.differences
    assert [difference.surplus for difference in inspection.differences] == [True, False, True]
    for difference, height, width in ((high, 0.8, 5), (dent, 0.5, 4), (low, 0.3, 2)):
        assert difference.height == pytest.approx(height, abs=0.03)
        assert difference.length == pytest.approx(width, abs=0.35)
        # A circular segment of this chord and height.
        radius = (width**2 / 4 + height**2) / (2 * height)
        sweep = 2 * np.arcsin(width / 2 / radius)
        assert difference.area == pytest.approx(radius**2 * (sweep - np.sin(sweep)) / 2, rel=0.12)
        assert difference.contour == "c1"
        assert not difference.whole
    # The side starts at -30, -20. The tip of a bump is above the middle of its foot.
    assert high.place == pytest.approx((-30 + 10 + 2.5, -20.8), abs=0.4)
    assert inspection.area(surplus=True) == pytest.approx(high.area + low.area)


@pytest.mark.usefixtures("few_rotations")
def test_a_hole_that_is_missing_is_surplus_material(tmp_path: Path) -> None:
    (difference,) = inspect_parts(tmp_path, PLATE[:1]).differences
    assert difference.surplus
    assert difference.kind == "feature missing"
    assert difference.contour == "c2"
    assert difference.area == pytest.approx(np.pi * 7**2, rel=0.01)
    assert difference.height == pytest.approx(7, abs=0.1)


def test_a_part_with_rotational_symmetry_has_rival_rotations(tmp_path: Path) -> None:
    square = (rounded([(-20, -20, 0), (20, -20, 0), (20, 20, 0), (-20, 20, 0)]),)
    inspection = inspect_parts(tmp_path, square, square, turn=0.1)
    rival_angles = np.degrees(inspection.fit.rival_turns)
    assert rival_angles == pytest.approx([-90, 90, 180], abs=0.2) or rival_angles == pytest.approx(
        [-180, -90, 90], abs=0.2
    )
    assert inspection.fit.turn == pytest.approx(-0.1, abs=1e-3)
    assert any("fits as well rotated" in note.what for note in inspection.notes)


def test_another_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"photo.png: does not show plate.dxf: \d+ % of its outline"
    ):
        inspect_parts(tmp_path, bracket())


# Kinds of differences.

HOLE = complex(-12, 4)


def list_kinds(inspection: Inspection) -> list[str]:
    return [difference.kind for difference in inspection.differences]


@pytest.mark.usefixtures("few_rotations")
def test_a_thing_apart_from_the_outline_is_loose_and_not_a_burr(tmp_path: Path) -> None:
    chip = box(-28, 24, 12, 26)  # 40 mm long, 4 mm above the part
    screw = circle(HOLE.real, HOLE.imag, 4)  # 3 mm from the wall of its hole
    loops = (bumped(PLATE[0], 0, 10, 5, 0.8), PLATE[1], chip, screw)
    inspection = inspect_parts(tmp_path, loops)
    assert list_kinds(inspection) == ["loose", "loose", "burr"]
    # The height is the radius of the largest circle inside the screw, or inside the chip.
    assert [loose.height for loose in inspection.differences[:2]] == pytest.approx([4, 1], abs=0.05)
    assert inspection.differences[0].place == pytest.approx((-12, 4), abs=0.1)
    assert inspection.differences[1].length == pytest.approx(40, abs=0.1)
    assert [burr.height for burr in inspection.burrs] == [pytest.approx(0.8, abs=0.03)]
    reworks, not_reworked = list_rework(inspection, Job(process=ProcessTable(feed=6.0)), 0.2)
    # 0.8 mm are four removals of 0.2 mm. The measured height may be 0.03 mm less.
    assert [(rework.number, rework.passes) for rework in reworks] in ([(3, 3)], [(3, 4)])
    assert reworks[0].feed * 0.8 == pytest.approx(6 * reworks[0].passes * 0.2, rel=0.05)
    assert [skipped.number for skipped in not_reworked] == [1, 2]
    assert all("apart from the part" in skipped.why for skipped in not_reworked)


@pytest.mark.usefixtures("few_rotations")
@pytest.mark.parametrize(
    ("outline", "kind"),
    [
        # One side of 60 mm deviates, more than a quarter of the outer contour of 195 mm.
        (rounded([(-30, -20, 0), (30, -20, 6), (30, 20.5, 0), (-30, 20.5, 0)]), "dimension"),
        # A tab, 2 mm wide and 4 mm high.
        (rounded([(-30, -20, 0), (30, -20, 6), (30, 20, 0), (1, 20, 0), (1, 24, 0), (-1, 24, 0),
                  (-1, 20, 0), (-30, 20, 0)]), "unclear"),
        # A notch, 4 mm wide and 1 mm deep.
        (bumped(PLATE[0], 3, 18, 4, -1.0), "dent"),
    ],
)  # fmt: skip
def test_a_deviation_that_is_not_a_burr_has_its_own_kind(
    tmp_path: Path, outline: Loop, kind: str
) -> None:
    inspection = inspect_parts(tmp_path, (outline, PLATE[1]))
    assert set(list_kinds(inspection)) == {kind}
    assert inspection.burrs == ()


@pytest.mark.usefixtures("few_rotations")
def test_a_part_that_is_larger_on_all_sides_has_no_burr(tmp_path: Path) -> None:
    larger = rounded([(-30.3, -20.3, 0), (30.3, -20.3, 6.3), (30.3, 20.3, 0), (-30.3, 20.3, 0)])
    inspection = inspect_parts(tmp_path, (larger, PLATE[1]))
    assert set(list_kinds(inspection)) == {"dimension"}
    # 0.3 mm at the sides, 0.3 sqrt(2) at the sharp corners, which are rounded by blur.
    assert 0.28 < inspection.differences[0].height < 0.3 * 2**0.5


@pytest.mark.usefixtures("few_rotations")
def test_a_screw_that_touches_its_hole_is_not_a_burr(tmp_path: Path) -> None:
    loops = (*PLATE, circle(HOLE.real + 2.95, HOLE.imag, 4))
    assert "burr" not in list_kinds(inspect_parts(tmp_path, loops))


@pytest.mark.usefixtures("few_rotations")
def test_a_hole_that_is_not_drawn_is_an_extra_feature(tmp_path: Path) -> None:
    inspection = inspect_parts(tmp_path, (*PLATE, hole(circle(15, -5, 3))))
    assert list_kinds(inspection) == ["feature extra"]
    assert inspection.differences[0].place == pytest.approx((15, -5), abs=0.1)
    assert inspection.differences[0].height == pytest.approx(3, abs=0.05)
    assert inspection.differences[0].area == pytest.approx(np.pi * 9, rel=0.03)


@pytest.mark.parametrize(
    ("height", "passes", "feed"),
    # 0.5 mm are 2.5 removals of 0.2 mm: two passes at 0.8 of the feed. A lower burr takes one pass.
    [(0.5, 2, 16.0), (0.6, 3, 20.0), (0.39, 1, 20 * 0.2 / 0.39), (0.1, 1, 20.0)],
)
def test_passes_and_feed_follow_the_height(height: float, passes: int, feed: float) -> None:
    assert plan_passes(height, 0.2, 20.0) == (passes, pytest.approx(feed))


def measure_burr_contact(width: float, height: float, removed: float, tool: float) -> float:
    """Distance from the middle of a round burr at which a tool meets it, after `removed` mm.

    The centre of the circle of the burr is below the line. The centres of two circles that touch
    are as far apart as the sum of their radii. All values are mm; `tool` is a radius.
    """
    radius = (width**2 / 4 + height**2) / (2 * height)
    below = radius - (height - removed)
    return math.sqrt((radius + tool) ** 2 - (below + tool) ** 2)


def test_a_rework_covers_the_burr_and_1_mm_at_either_side(burred: Inspection) -> None:
    job = Job(process=ProcessTable(feed=6.0), tool=ToolTable(diameter=6.0))
    (rework,), _ = list_rework(burred, job, 0.3)
    # The foot is from -20 to -15 on y = -20. A tool on the line meets the burr where the two
    # circles touch. The stretch begins 1 mm before.
    reach = measure_burr_contact(5, 0.8, 0.0, 3.0) + 1
    assert rework.stretches[0][0] == pytest.approx((-17.5 - reach, -20), abs=0.15)
    assert rework.stretches[0][-1] == pytest.approx((-17.5 + reach, -20), abs=0.15)
    assert is_clear(rework.stretches[0], burred.expected.region, 3.0)


def test_later_passes_over_a_burr_are_shorter(burred: Inspection) -> None:
    """Four passes over an arc 0.8 mm high with a chord of 5 mm meet less and less of it.

    Without force the later passes begin 0.35 mm before contact, with force all begin 1 mm before.
    """
    for force, later_margin in ((0.0, 0.35), (5.0, 1.0)):
        process = ProcessTable(feed=6.0, force=force)
        job = Job(process=process, tool=ToolTable(diameter=6.0))
        (rework,), _ = list_rework(burred, job, 0.19)
        lengths = [float(np.ptp(stretch[:, 0])) for stretch in rework.stretches]
        assert rework.passes == 4
        for number, length in enumerate(lengths):
            removed = max(0.2 * number - 0.05, 0.0)
            margin = later_margin if number else 1.0
            reach = measure_burr_contact(5, 0.8, removed, 3.0) + margin
            assert length == pytest.approx(2 * reach, abs=0.3), number


@pytest.mark.usefixtures("few_rotations")
def test_a_part_with_a_wrong_dimension_is_not_reworked(tmp_path: Path) -> None:
    wide = hole(circle(HOLE.real, HOLE.imag, 7.4))
    inspection = inspect_parts(tmp_path, (bumped(PLATE[0], 0, 10, 5, 0.8), wide))
    assert sorted(list_kinds(inspection)) == ["burr", "dimension"]
    reworks, not_reworked = list_rework(inspection, Job(), 0.2)
    assert reworks == ()
    assert [skipped.number for skipped in not_reworked] == [1, 2]
    assert "a contour is off" in not_reworked[0].why


def test_a_loose_thing_is_in_the_way_within_the_sweep_of_the_tool() -> None:
    # The tool of 6 mm sweeps 6 mm at one side of the stretch, and returns 3 mm farther out.
    stretch, job = np.array([[0.0, 0.0], [10.0, 0.0]]), Job(tool=ToolTable(diameter=6.0))
    assert is_in_the_way(stretch, shapely.box(2, -10, 4, -8.9), job)
    assert not is_in_the_way(stretch, shapely.box(2, -10, 4, -9.1), job)
    assert not is_in_the_way(stretch, shapely.union_all([]), job)


def test_a_tool_wider_than_a_slot_is_not_clear_of_its_walls() -> None:
    # Two walls 5 mm apart, and a stretch along the upper edge of the lower one.
    walls = shapely.union(shapely.box(0, -5, 40, 0), shapely.box(0, 5, 40, 10))
    stretch = np.array([[30.0, 0.0], [10.0, 0.0]])
    assert is_clear(stretch, walls, 2.5)
    assert not is_clear(stretch, walls, 3.0)
    assert not is_clear(stretch[::-1], walls, 2.5)  # the tool is on the side of the material


def test_an_invalid_removal_is_refused(burred: Inspection) -> None:
    for removal in (0.0, -1.0, float("nan")):
        with pytest.raises(JobError, match="--removal"):
            list_rework(burred, Job(), removal)
    with pytest.raises(JobError, match=r"0.01 mm would make \d\d passes over the burr of 0.8"):
        list_rework(burred, Job(), 0.01)


# Ink.

FILL = Job(operation=OperationTable(kind="fill"), tool=ToolTable(diameter=1.0))
TRACKS = (box(-20, -8, 5, 8), box(10, -15, 25, -11), box(10, 5, 12, 15))


def make_loops(region: shapely.Geometry) -> list[Loop]:
    """Polygons as loops of the renderer: outer rings counter-clockwise, holes clockwise."""
    loops = []
    for part in shapely.get_parts(region):
        for ring, inside in ((part.exterior, False), *((ring, True) for ring in part.interiors)):
            points = shapely.get_coordinates(ring)[:-1]
            outline = points[:, 0] + 1j * points[:, 1]
            loops.append(
                Loop(outline if ring.is_ccw != inside else outline[::-1], np.zeros(len(outline)))
            )
    return loops


@pytest.mark.usefixtures("few_rotations")
def test_missing_and_extra_ink_is_found(tmp_path: Path) -> None:
    whole = expect(drawing(TRACKS), FILL)
    assert whole.inked
    assert whole.region.area == pytest.approx(25 * 16 + 15 * 4 + 2 * 10, rel=0.02)
    gap, spill = shapely.box(14, -16, 17, -10), shapely.box(-2, 11, 2, 13)
    ink = shapely.union(shapely.difference(whole.region, gap), spill)
    files = Files()
    outlines = read_outlines(
        files.read(photo(tmp_path / "photo.png", make_loops(ink))), PHOTO_JOB, files
    )
    inspection = inspect_photo(outlines, drawing(TRACKS), FILL)
    extra, missing = sorted(inspection.differences, key=lambda difference: not difference.surplus)
    assert (extra.surplus, missing.surplus) == (True, False)
    assert extra.whole
    assert extra.area == pytest.approx(4 * 2, rel=0.05)
    assert extra.length == pytest.approx(4, abs=0.2)
    assert missing.area == pytest.approx(shapely.intersection(whole.region, gap).area, rel=0.05)
    assert inspection.area(surplus=False) == missing.area


# The command.


@pytest.fixture(scope="module")
def desk_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    loops = (bumped(PLATE[0], 0, 10, 5, 0.8), PLATE[1])
    photo(folder / "photo.png", loops, 0.3)
    photo(folder / "good.png", PLATE, 0.3)
    write_dxf(folder / "plate.dxf", PLATE)
    (folder / "plate.toml").write_text("[process]\nfeed = 8.0\n")
    for name in ("photo", "good"):
        (folder / f"{name}.toml").write_text(f"[image]\nmm_per_px = {PIXEL}\n")
    return folder


@pytest.fixture
def desk(desk_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in desk_files.iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("few_rotations")
def test_the_command_lists_burrs_draws_them_and_writes_a_rework(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "inspect",
        "photo.png",
        "--against",
        "plate.dxf",
        "--removal",
        "0.3",
        "--rework",
        "again.toml",
    ]
    assert main([*words, "--preview", "a.svg"]) == 0
    out = capsys.readouterr().out
    assert "too much: 1 place, 2." in out
    assert "missing: nothing from 0.14 mm on" in out
    settings = re.search(r"burr 1: 2 passes at ([\d.]+) mm/s", out)
    assert settings
    # 0.8 mm in two passes of 0.3 mm at 8 mm/s: 0.75 of the feed.
    assert float(settings[1]) == pytest.approx(8 * 0.6 / 0.8, rel=0.05)
    text = (desk / "a.svg").read_text()
    assert text.startswith("<svg ")
    assert "1 place with too much" in text
    assert ">1 burr</text>" in text
    again = (desk / "again.toml").read_text()
    assert again.count('layers = ["burr1-1"]') == again.count('layers = ["burr1-2"]') == 1
    # The job and the drawing of the rework need no other files.
    (desk / "plate.toml").unlink()
    (desk / "plate.dxf").rename(desk / "moved.dxf")
    assert main(["build", "again.dxf", "--post", "rapid", "-o", "again.mod"]) == 0
    assert "plan      2 paths, work" in capsys.readouterr().err
    (desk / "moved.dxf").rename(desk / "plate.dxf")
    (desk / "plate.toml").write_text("[process]\nfeed = 8.0\n")
    # A job file selects the drawing of its name. A PNG preview has the same content.
    assert main(["inspect", "photo.png", "--against", "plate.toml", "--preview", "a.png"]) == 0
    assert "1 burr, the highest 0.8" in capsys.readouterr().out
    assert cv2.imread(str(desk / "a.png")).shape[1] > 1000


@pytest.mark.usefixtures("few_rotations")
def test_a_difference_is_an_error_with_strict(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", "good.png", "--against", "plate.dxf", "--strict"]) == 0
    capsys.readouterr()
    assert (
        main(["inspect", "photo.png", "--against", "plate.dxf", "--strict", "--preview", "a.svg"])
        == 4
    )
    output = capsys.readouterr()
    assert output.out == ""
    assert "photo.png: differs from plate.dxf in 1 place, first: burr at -17." in output.err
    assert not (desk / "a.svg").exists()


@pytest.mark.usefixtures("few_rotations")
def test_a_rework_without_a_burr_is_refused(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["inspect", "good.png", "--against", "plate.dxf", "--removal", "0.2"]
    assert main([*words, "--rework", "again.toml"]) == 3
    assert "good.png: shows no burr that can be worked again" in capsys.readouterr().err
    assert not list(desk.glob("again.*"))


@pytest.mark.usefixtures("few_rotations")
def test_the_job_of_a_rework_keeps_tool_process_and_cell(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (desk / "cells").mkdir()
    (desk / "cells" / "cell.toml").write_text('[cell]\nfixtures = ["clamp.stl"]\n')
    (desk / "plate.toml").write_text(
        "[tool]\nnumber = 7\ndiameter = 4.0\n[process]\nfeed = 8.0\nforce = 2.0\nspindle = 9000\n"
        'stay_down = true\n[operation]\ndepth = 1.5\n[cell]\nfile = "cells/cell.toml"\n'
    )
    words = ["inspect", "photo.png", "--against", "plate.dxf", "--removal", "0.3"]
    (desk / "out").mkdir()
    assert main([*words, "--rework", "out/again.toml"]) == 0
    capsys.readouterr()
    job = load_job(desk / "out" / "again.toml")
    assert (job.tool.number, job.tool.diameter) == (7, 4.0)
    assert (job.process.force, job.process.spindle, job.process.stay_down) == (2.0, 9000.0, False)
    assert [step.operation.depth for step in job.operations] == [1.5, 1.5]
    assert [step.tool.number for step in job.operations] == [7, 7]
    # The force builds up on the lead-in and lead-out.
    assert {step.operation.lead_in for step in job.operations} == {2.0}
    assert "process.force is 0" not in (desk / "out" / "again.toml").read_text()
    (fixture,) = job.cell.fixtures or ()
    assert Path(str(fixture)).resolve() == desk / "cells" / "clamp.stl"


@pytest.mark.usefixtures("few_rotations")
def test_a_rework_without_force_is_warned_about(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["inspect", "photo.png", "--against", "plate.dxf", "--removal", "0.3"]
    assert main([*words, "--rework", "again.toml"]) == 0
    whole = "the first pass takes off the whole height of each burr"
    assert whole in capsys.readouterr().err
    assert whole in (desk / "again.toml").read_text()


@pytest.mark.usefixtures("few_rotations")
def test_passes_over_a_burr_without_force_plunge_once(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tool returns 3 mm off the contour, at the depth of the passes."""
    words = ["inspect", "photo.png", "--against", "plate.dxf", "--removal", "0.2"]
    assert main([*words, "--rework", "again.toml"]) == 0
    capsys.readouterr()
    job = load_job(desk / "again.toml")
    passes = len(job.operations)
    assert passes > 2
    assert [step.process.stay_down for step in job.operations] == [False] + [True] * (passes - 1)
    result = build(desk / "again.dxf", post="gcode", job=job)
    moves = [item for item in result.program.body if isinstance(item, (MoveJ, MoveL))]
    ends = np.array([move.target.origin for move in moves if isinstance(move.target, Pose)])
    low = ends[:, 2] <= 0
    assert np.flatnonzero(np.diff(low.astype(int))).size == 2  # one plunge and one retract
    line, radius = ends[low][0, 1], job.tool.radius
    distance = np.abs(ends[low][:, 1] - line)
    # Each return has two positions off the contour, as far as the highest burr.
    assert np.allclose(distance[distance > radius / 10], BURR_HEIGHT)
    assert (distance > radius / 10).sum() == 2 * (passes - 1)


def test_a_symmetric_part_is_reworked_only_if_its_rotation_is_certain() -> None:
    square = shapely.box(-20, -20, 20, 20)
    sides = tuple(Fit(turn, (0.0, 0.0), 1.0, 0.0) for turn in (-np.pi / 2, np.pi / 2, np.pi))
    check_pose("photo.png", Fit(0.1, (3.0, 0.0), 1.0, 0.0, 0.2, sides), square)
    check_pose("photo.png", Fit(1.0, (30.0, 0.0), 1.0, 0.0, 0.2), square)
    for turn, shift in ((0.2, (0.0, 0.0)), (0.0, (4.0, 4.0))):
        with pytest.raises(NoSafeProgram, match="may be on another one"):
            check_pose("photo.png", Fit(turn, shift, 1.0, 0.0, 0.2, sides), square)


@pytest.mark.parametrize(
    ("force", "tool", "is_down"),
    [
        (0.0, {}, True),
        (2.0, {}, False),
        (0.0, {"orient": "follow"}, False),
        # An arm rotates these tools between the paths, which `process.stay_down` excludes.
        (0.0, {"symmetric": True}, False),
        (0.0, {"turn": [-10.0, 10.0]}, False),
    ],
)
def test_force_and_a_rotating_tool_need_a_lift_between_passes(
    force: float, tool: dict[str, object], is_down: bool
) -> None:
    job = from_mapping({"process": {"force": force}, "tool": tool})
    assert stays_down(job) == is_down


@pytest.mark.usefixtures("few_rotations", "desk")
def test_the_list_is_printed_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["inspect", "photo.png", "--against", "plate.dxf", "--removal", "0.3", "--json"]
    assert main(words) == 0
    facts = json.loads(capsys.readouterr().out)
    (difference,) = facts["differences"]
    assert (difference["kind"], difference["contour"]) == ("burr", "c1")
    assert [(work["number"], work["passes"]) for work in facts["rework"]] == [(1, 2)]
    assert facts["not_reworked"] == []


@pytest.mark.usefixtures("few_rotations")
def test_a_rework_of_a_job_without_contours_is_refused(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["inspect", "photo.png", "--against", "plate.dxf", "--removal", "0.3"]
    (desk / "plate.toml").write_text('[operation]\nkind = "drill"\n')
    assert main([*words, "--rework", "again.toml"]) == 2
    assert "--rework: works along contours, and this job is drill" in capsys.readouterr().err
    (desk / "plate.toml").write_text('[[operations]]\nkind = "follow"\n')
    assert main([*words, "--rework", "again.toml"]) == 2
    assert "the job of the drawing has several operations" in capsys.readouterr().err


@pytest.mark.usefixtures("few_rotations")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["good.png", "--least", "0.2"], "--least: has no effect without --against"),
        (["good.png", "--strict"], "--strict: has no effect without --against"),
        (["good.png", "--against", "plate.dxf", "--rework", "r.toml"], "--rework: needs --removal"),
        (
            ["good.png", "--against", "plate.dxf", "--removal", "1", "--rework", "r.txt"],
            "r.txt: is not the name of a job file",
        ),
        (
            ["photo.png", "--against", "plate.dxf", "--removal", "1", "--rework", "plate.toml"],
            "plate.toml",
        ),
        (
            ["good.png", "--against", "plate.dxf", "--preview", "a.html"],
            "a.html: is not a kind of picture",
        ),
        (["good.png", "--against", "plate.dxf", "--least", "0"], "--least: cannot be 0 mm"),
        (["good.png", "--against", "plate.dxf", "--removal", "0"], "--removal: cannot be 0 mm"),
        (["good.png", "--against", "none.dxf"], "none.dxf: no such file"),
        (["good.png", "--against", "other.toml"], "other.toml: has no input of its name beside it"),
        (
            ["plate.dxf", "--against", "plate.dxf"],
            "plate.dxf: is not a PNG, JPEG, TIFF, BMP or PGM image",
        ),
        (["good.png", "--against", "plate.dxf", "--preview", "photo.png/a.svg"], "a.svg"),
        (["good.png", "--against", "good.png", "--preview", "good.png"], "good.png"),
    ],
)
def test_invalid_options_are_refused_in_one_line(
    desk: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    before = sorted(desk.iterdir())
    assert main(["inspect", *words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    assert message in line
    assert sorted(desk.iterdir()) == before
