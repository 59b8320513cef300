"""Units of the model and of the scan: options, what files state, and advice that was tried."""

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from camgen import cli
from camgen.localize import Location, localize
from camgen.localize.advice import ModelPart, localize_or_advise
from camgen.localize.scans import Scan, read_scan
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.files import Source
from camgen.model.pose import FloatArray
from tests.support.clouds import ROUND, scan

pytestmark = pytest.mark.usefixtures("localize_once")
Captured = pytest.CaptureFixture[str]
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
CASES = Path(__file__).parents[2].parent / "shared" / "data" / "cases"
#: The pose of the simulated scans, mm and deg. A pose with a small turn is found soon.
TRUTH = (220.0, -75.0, 40.0, 12.0, -18.0, 25.0)
#: The pose of the shared cases, mm and deg.
TRUTH_OF_CASES = (220.0, -75.0, 40.0, 12.0, -18.0, 140.0)
#: The corners of a block of 100 x 60 x 20 mm with its low corner at the origin.
SIDES = (100.0, 60.0, 20.0)


def run(*words: object) -> int:
    return cli.main(["localize", *map(str, words)])


@pytest.fixture(scope="module")
def cloud() -> FloatArray:
    """A scan of rfa1, mm, in its pose of TRUTH."""
    angles = np.radians(TRUTH[3:])
    turn = trimesh.transformations.euler_matrix(*angles, "sxyz")[:3, :3]
    part = trimesh.load_mesh(PARTS / "rfa1.stl")
    points: FloatArray = scan(part, 6000, 1, ROUND, 0.05, 0.1) @ turn.T + np.array(TRUTH[:3])
    return points


@pytest.fixture
def folder(cloud: FloatArray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the part in mm and in m, and its scan in mm."""
    part = trimesh.load_mesh(PARTS / "rfa1.stl")
    shutil.copy(PARTS / "rfa1.stl", tmp_path / "mm.stl")
    part.apply_scale(0.001)
    part.export(tmp_path / "metre.stl")
    part.export(tmp_path / "metre.glb")
    np.savetxt(tmp_path / "mm.xyz", cloud, fmt="%.5f")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pose_in(path: Path) -> list[float]:
    values: list[float] = tomllib.loads(path.read_text())["cell"]["base_from_work"]
    return values


def test_a_model_in_metres_is_converted(folder: Path, capsys: Captured) -> None:
    assert run("metre.stl", "mm.xyz", "-o", "frame.toml") == 2
    size = "a part of 125 x 95 x 70 mm"
    assert capsys.readouterr().err.endswith(f"it is found with --model-units m ({size})\n")
    assert not (folder / "frame.toml").exists()
    assert run("metre.stl", "mm.xyz", "-o", "frame.toml", "--model-units", "m") == 0
    assert pose_in(folder / "frame.toml") == pytest.approx(TRUTH, abs=0.05)
    summary = capsys.readouterr().err
    assert "metre.stl: 125 x 95 x 70 mm, 396 triangles, 1 unit = 1000 mm" in summary
    assert "mm.xyz: 6 000 points, 1 unit = 1 mm" in summary
    comment = "# units: 1 unit = 1000 mm in the model, 1 unit = 1 mm in the scan\n"
    assert comment in (folder / "frame.toml").read_text()


def test_a_scan_in_another_unit_is_converted(
    folder: Path, cloud: FloatArray, capsys: Captured
) -> None:
    np.savetxt(folder / "scan.xyz", cloud * 1000, fmt="%.3f")
    assert run("mm.stl", "scan.xyz", "-o", "frame.toml") == 2
    size = "a part of 125 x 95 x 70 mm"
    assert capsys.readouterr().err.endswith(f"it is found with --units um ({size})\n")


def test_the_unit_of_a_model_file_is_used(folder: Path, capsys: Captured) -> None:
    assert run("metre.glb", "mm.xyz", "-o", "frame.toml", "--model-units", "m") == 0
    assert pose_in(folder / "frame.toml") == pytest.approx(TRUTH, abs=0.05)
    capsys.readouterr()
    assert run("metre.glb", "mm.xyz", "-o", "other.toml", "--model-units", "mm") == 2
    message = "--model-units: says mm, and metre.glb states its unit: m; leave it out"
    assert capsys.readouterr().err == f"camgen: error: {message}\n"
    assert run("mm.stl", "mm.xyz", "-o", "other.toml", "--model-units", "ell") == 2
    assert "--model-units: unknown unit 'ell'; give mm, cm" in capsys.readouterr().err


def test_the_unit_of_a_scan_file_is_used(folder: Path, cloud: FloatArray, capsys: Captured) -> None:
    np.savetxt(
        folder / "head.csv", cloud / 1000, fmt="%.8f", delimiter=";", header="X [m];Y [m];Z [m]"
    )
    assert run("mm.stl", "head.csv", "-o", "frame.toml") == 0
    assert pose_in(folder / "frame.toml") == pytest.approx(TRUTH, abs=0.05)
    assert "assumed   1 unit of the scan = 1 m (its head)" in capsys.readouterr().err
    assert run("mm.stl", "head.csv", "-o", "other.toml", "--units", "mm") == 2
    message = "--units: says mm, and head.csv is in m: its head says so"
    assert message in capsys.readouterr().err


def test_coordinates_far_from_the_origin_are_exact(folder: Path, cloud: FloatArray) -> None:
    """The scan is 483 km east and 5456 km north of the origin; the pose is exact to 2 um."""
    far = np.array([483_000.0, 5_456_000.0, 312.0])
    np.savetxt(folder / "far.xyz", cloud / 1000 + far, fmt="%.9f")
    assert run("mm.stl", "mm.xyz", "-o", "near.toml") == 0
    assert run("mm.stl", "far.xyz", "-o", "far.toml", "--units", "m") == 0
    near, far_pose = pose_in(folder / "near.toml"), pose_in(folder / "far.toml")
    moved = [near[0] + 483e6, near[1] + 5456e6, near[2] + 312e3]
    assert far_pose == pytest.approx([*moved, *near[3:]], abs=2e-3)
    # The file has all 13 or 14 digits, without an exponent.
    assert "base_from_work = [4830002" in (folder / "far.toml").read_text()


def test_a_frame_that_no_build_takes_is_a_warning(
    folder: Path, cloud: FloatArray, capsys: Captured
) -> None:
    np.savetxt(folder / "far.xyz", cloud + np.array([0, 2e6, 0]), fmt="%.5f")
    assert run("mm.stl", "far.xyz", "-o", "far.toml") == 0
    what = "warning   the part stands 2 km from the origin of the scan"
    assert f"{what} (builds take frames up to 1e+06 mm: move" in capsys.readouterr().err


def test_points_that_are_not_used_are_counted(
    folder: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("camgen.localize._MANY", 5000)
    monkeypatch.setattr("camgen.cli.localize.localize", localize)
    assert run("mm.stl", "mm.xyz", "-o", str(folder / "frame.toml")) == 0
    note = "assumed   5 000 points of 6 000 points were used (drawn with a fixed seed)"
    assert note in capsys.readouterr().err


def test_points_too_far_away_are_counted_in_the_refusal() -> None:
    good = "".join(f"{k}.5 {k % 7}.5 {k % 3}\n" for k in range(120))
    seen = read_scan(Source(Path("a.xyz"), (good + "2e11 1 1\n1e308 1 1\nnan 1 1\n").encode()))
    assert len(seen.points) == 120
    assert [str(note) for note in seen.notes] == [
        "repaired: 1 point with coordinates that are not numbers was left out",
        "repaired: 2 points beyond 1e+11 mm were left out (no scan is so far from its origin)",
    ]
    with pytest.raises(InputError) as error:
        read_scan(Source(Path("a.xyz"), b"2e11 1 1\n" * 120))
    message = "a.xyz: has 0 usable points (120 more are beyond 1e+11 mm); a scan needs 100 or more"
    assert str(error.value) == message


# Which units are tried, with a search that finds the part at one size only.


def block(unit: str = "mm", stated: bool = False) -> ModelPart:
    """The block, as its file of numbers 100, 60 and 20 is read in a unit."""
    mm = {"um": 0.001, "mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}[unit]
    vertices = mm * np.array([[0.0, 0.0, 0.0], SIDES])
    return ModelPart(vertices, np.zeros((0, 3), np.int64), [], unit, stated)


def cloud_of(sides: FloatArray, stated: bool = False) -> Scan:
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    return Scan(grid * sides, (), "mm", stated)


Search = Callable[[ModelPart, Scan], Location]


def search_for(answer: Callable[[float], None]) -> Search:
    """A search that gives `answer` the size of the scan as a share of the size of the part."""

    def search(part: ModelPart, cloud: Scan) -> Location:
        answer(float(np.ptp(cloud.points[:, 0]) / np.ptp(part.vertices[:, 0])))
        raise NoSafeProgram("scan", "may stand elsewhere")

    return search


def check_true_size(ratio: float) -> None:
    if not 0.99 < ratio < 1.01:
        raise InputError("scan", "not found", "", "check it")


ADVICE = {
    # The numbers of the scan are a thousandth of the model's: a model in um would be 0.1 mm long.
    "scan in m": (0.001, "mm", "--units m (a part of 100 x 60 x 20 mm)"),
    "scan in cm": (0.1, "mm", "--units cm (a part of 100 x 60 x 20 mm)"),
    "scan in inch": (1 / 25.4, "mm", "--units inch (a part of 100 x 60 x 20 mm)"),
    # Read in um the model is 0.1 mm long and the scan 100 mm.
    "model in mm": (1.0, "um", "--model-units mm (a part of 100 x 60 x 20 mm)"),
    # The model may be in inches, and the scan in mm.
    "model in inch": (25.4, "mm", "--model-units inch (a part of 2540 x 1524 x 508 mm)"),
    "both": (
        1.0,
        "cm",
        "--model-units mm (a part of 100 x 60 x 20 mm), "
        "and with --units cm (a part of 1000 x 600 x 200 mm)",
    ),
}


@pytest.mark.parametrize("kind", ADVICE)
def test_a_unit_in_which_the_part_is_found_is_advised(kind: str) -> None:
    factor, unit, advice = ADVICE[kind]
    cloud = cloud_of(factor * np.array(SIDES))
    with pytest.raises(InputError) as error:
        localize_or_advise(search_for(check_true_size), block(unit), cloud, block)
    assert str(error.value) == f"scan: not found; it is found with {advice}"


@pytest.mark.parametrize("factor", [0.001, 0.1, 1 / 25.4, 1000.0, 1.0])
def test_no_unit_is_advised_if_the_part_is_not_found_in_any(factor: float) -> None:
    ratios = []

    def never(ratio: float) -> None:
        ratios.append(ratio)
        raise InputError("scan", "not found", "", "check it")

    cloud = cloud_of(factor * np.array(SIDES))
    with pytest.raises(InputError) as error:
        localize_or_advise(search_for(never), block(), cloud, block)
    assert str(error.value) == "scan: not found; check it"
    assert ratios[0] == pytest.approx(factor)
    assert len(ratios) == 1 if factor == 1 else 2 <= len(ratios) <= 3


def test_a_unit_that_a_file_states_is_not_advised() -> None:
    cloud = cloud_of(0.001 * np.array(SIDES), stated=True)
    with pytest.raises(InputError, match="check it"):
        localize_or_advise(search_for(check_true_size), block(), cloud, block)
    cloud = cloud_of(1000 * np.array(SIDES), stated=True)
    with pytest.raises(InputError, match="check it"):
        localize_or_advise(search_for(check_true_size), block("mm", stated=True), cloud, block)


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared data is not beside the repository")
@pytest.mark.parametrize(
    ("model", "cloud_name", "options", "moved"),
    [
        ("loc_plate.stl", "loc_head_id.csv", (), (0, 0, 0)),
        ("loc_plate.stl", "loc_decimal_comma.csv", (), (0, 0, 0)),
        ("loc_plate.stl", "loc_upper.pcd", (), (0, 0, 0)),
        ("loc_plate_metre.stl", "loc_plate.xyz", ("--model-units", "m"), (0, 0, 0)),
        ("loc_plate.stl", "loc_utm.xyz", ("--units", "m"), (483e6, 5456e6, 312e3)),
    ],
)
def test_a_case_with_units_is_located_at_its_pose(
    model: str, cloud_name: str, options: tuple[str, ...], moved: FloatArray, tmp_path: Path
) -> None:
    target = tmp_path / "frame.toml"
    assert run("-q", CASES / model, CASES / cloud_name, "-o", target, *options) == 0
    wanted = np.array(TRUTH_OF_CASES) + np.array([*moved, 0, 0, 0])
    assert pose_in(target) == pytest.approx(wanted, rel=0, abs=0.02)
