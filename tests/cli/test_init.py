"""`camgen init` proposes operations: as comments, or with `--operations` as rows of the job."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import ezdxf
import pytest

from camgen.cli import main
from camgen.pipeline import build
from tests.support.built import build_once, key_of_parts

ROOT = Path(__file__).parents[2]
FIXTURES = sorted((ROOT / "fixtures" / "parts").glob("*.dxf"))
SHARED_FOLDER = ROOT.parent / "shared" / "data" / "dxf"
#: Drawings of the shared data whose closed contours cannot be milled, and the message.
REFUSED = {
    "2_polylines.dxf": "a coordinate is beyond 99999 mm",  # land, surveyed in metres
    "dimension_in_nested_blocks.dxf": "a coordinate is beyond 99999 mm",
    "wipeout_door.dxf": "a coordinate is beyond 99999 mm",  # a house
    "ellipse.dxf": "no closed contour",  # they cross
    "6_closed_loop_with_arcs.dxf": "no closed contour",  # it crosses itself
}
#: The drawings of the shared data that hold closed contours.
SHARED = (
    "SofleKeyboard/OLED_Cover.dxf",
    "SofleKeyboard/SofleKeyboardTopPlate_ShapeOnly.dxf",
    "SofleKeyboard/sofle_pico_key_plate_v3.5.5.dxf",
    "cad-viewer/block-color.dxf",
    "cadquery/1001.dxf",
    "cadquery/MC 12x31.dxf",
    "cadquery/gear.dxf",
    "cadquery/genshi.dxf",
    "cadquery/three_layers.dxf",
    "dxf/arrayed-holes.dxf",
    "dxf/issue27c.dxf",
    "dxf/issue39.dxf",
    "dxf/issue42.dxf",
    "dxf/squircle2.dxf",
    "dxf/testModelPaperSpace.dxf",
    "dxf-parser/ellipse.dxf",
    "dxf-parser/polylines.dxf",
    "ezdxf/2_polylines.dxf",
    "ezdxf/5_us_states.dxf",
    "ezdxf/6_closed_loop_with_arcs.dxf",
    "ezdxf/AC1003_LINE_Example.dxf",
    "ezdxf/R12_with_trash_beyond_EOF.dxf",
    "ezdxf/dimension_in_nested_blocks.dxf",
    "ezdxf/duplicate_handles.dxf",
    "ezdxf/empty_handles.dxf",
    "ezdxf/forms.dxf",
    "ezdxf/hatches_2.dxf",
    "ezdxf/issue_1359_1.dxf",
    "ezdxf/recover02.dxf",
    "ezdxf/uncommon.dxf",
    "ezdxf/wipeout_door.dxf",
    "redox-keyboard/redox_rev1-brd.dxf",
    "trimesh/LM2.dxf",
    "trimesh/insert.dxf",
    "trimesh/sliding-base.dxf",
    "trimesh/uc.r12a.dxf",
    "trimesh/uc.r12b.dxf",
    "trimesh/uc.r14a.dxf",
    "trimesh/uc.r14b.dxf",
    "trimesh/uc.r2000b.dxf",
    "trimesh/uc.r2013a.dxf",
    "trimesh/uc.r2013b.dxf",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The empty folder in which the commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """`init` and `build` of one job and one part build it once."""
    builder = build_once(build, key_of_parts)
    monkeypatch.setattr("camgen.pipeline.build", builder)
    monkeypatch.setattr("camgen.cli.build.build", builder)


def read_tables(file: Path) -> dict[str, Any]:
    """The tables of a job file."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


def read_comments(text: str) -> dict[str, Any]:
    """The rows of tools and operations that a job file has as comments."""
    rows = text.partition("# Delete the # in front to use it.")[2].partition("\n[post]")[0]
    rows = rows or text.partition("to use it.\n")[2].partition("\n[post]")[0]
    return tomllib.loads(
        "\n".join(line.removeprefix("#").removeprefix(" ") for line in rows.splitlines())
    )


def test_proposed_operations_are_comments_without_the_option(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(ROOT / "fixtures" / "parts" / "motor.dxf")
    assert main(["init", source]) == 0
    assert "as comments; --operations uses it" in capsys.readouterr().err
    text = (folder / "motor.toml").read_text(encoding="utf-8")
    assert "operations" not in read_tables(folder / "motor.toml")
    (folder / "motor.toml").unlink()
    assert main(["init", source, "--operations"]) == 0
    job = read_tables(folder / "motor.toml")
    stock = {"thickness": 3.0, "below": 0.5, "margin": 16.0, "layer": "", "held": "frame"}
    assert job["stock"] == stock
    proposed = read_comments(text)
    assert proposed == {"tools": job["tools"], "operations": job["operations"]}
    assert len(proposed["operations"]) == 7


@pytest.mark.usefixtures("built_once")
@pytest.mark.parametrize("file", FIXTURES, ids=lambda file: file.name)
def test_the_proposal_for_a_fixture_builds_unchanged(file: Path, folder: Path) -> None:
    assert main(["init", str(file), "--operations"]) == 0
    job = folder / file.with_suffix(".toml").name
    assert read_tables(job)["operations"]
    assert main(["build", str(file), "--job", str(job), "--post", "gcode"]) == 0


@pytest.mark.usefixtures("built_once")
@pytest.mark.parametrize("name", SHARED)
def test_the_proposal_for_a_real_drawing_builds_unchanged(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = SHARED_FOLDER / name
    if not file.is_file():
        pytest.skip(f"{name} of the folder shared/data beside the repository is absent")
    job = folder / file.with_suffix(".toml").name
    if file.name in REFUSED:
        assert main(["init", str(file), "--operations"]) == 2
        assert REFUSED[file.name] in capsys.readouterr().err
        assert not job.exists()
        return
    assert main(["init", str(file), "--operations"]) == 0
    assert main(["build", str(file), "--job", str(job), "--post", "gcode"]) == 0


def test_a_drawing_without_closed_contours_has_no_operations(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = ezdxf.new("R2010", units=4)
    document.modelspace().add_line((0, 0), (10, 0))
    document.saveas(folder / "line.dxf")
    assert main(["init", "line.dxf", "--operations"]) == 2
    message = capsys.readouterr().err
    assert (
        "line.dxf: has no closed contour that a drill or a mill could make (--operations)"
        in message
    )
    assert not (folder / "line.toml").exists()
    assert main(["init", "line.dxf"]) == 0
    assert "proposed" not in capsys.readouterr().err


def test_a_refused_coordinate_is_not_tried_with_a_skin_in_place_of_tabs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = ezdxf.new("R2010", units=4)
    x, y = 200_000, 0
    corners = [(x, y), (x + 90, y), (x + 90, y + 60), (x, y + 60)]
    document.modelspace().add_lwpolyline(corners, close=True)
    document.saveas(folder / "far.dxf")
    assert main(["init", "far.dxf", "--operations"]) == 2
    message = capsys.readouterr().err
    assert "a coordinate is beyond 99999 mm" in message
    assert "skin" not in message


@pytest.mark.parametrize("name", ["rfa1.stl", "gear.png"])
def test_operations_for_a_solid_or_a_picture_are_refused(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", str(ROOT / "fixtures" / "parts" / name), "--operations"]) == 2
    assert f"{name}: is not a flat drawing (--operations); leave it out" in capsys.readouterr().err
    assert not list(folder.glob("*.toml"))


def test_many_ids_are_written_on_several_lines(folder: Path) -> None:
    """Wide holes on the layer of drilled holes are chosen by their ids, 30 of 60."""
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    for k in range(60):
        space.add_circle((30 * k, 0), 4 if k % 2 else 9)
    space.add_lwpolyline([(-30, -30), (1830, -30), (1830, 30), (-30, 30)], close=True)
    document.saveas(folder / "row.dxf")
    assert main(["init", "row.dxf", "--operations"]) == 0
    text = (folder / "row.toml").read_text(encoding="utf-8")
    proposed = text.partition("# Proposed")[2].partition("[post]")[0]
    assert max(map(len, proposed.splitlines())) <= 118
    assert [len(row.get("ids", [])) for row in read_tables(folder / "row.toml")["operations"]] == [
        0,
        30,
        0,
    ]
