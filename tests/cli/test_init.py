"""``camgen init`` proposes operations: as comments, or with ``--operations`` as a job that builds as it is."""

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
#: Drawings of the shared data with closed contours that no job of a mill can be made of, and why.
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
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A job file that asks for the same job of the same part gets the result of ``init``."""
    once = build_once(build, key_of_parts)
    monkeypatch.setattr("camgen.pipeline.build", once)
    monkeypatch.setattr("camgen.cli.build.build", once)


def tables(file: Path) -> dict[str, Any]:
    return tomllib.loads(file.read_text(encoding="utf-8"))


def uncommented(text: str) -> dict[str, Any]:
    """The rows that are proposed in comments."""
    rows = text.partition("# Delete the # in front to use it.")[2].partition("\n[post]")[0]
    rows = rows or text.partition("to use it.\n")[2].partition("\n[post]")[0]
    return tomllib.loads(
        "\n".join(line.removeprefix("#").removeprefix(" ") for line in rows.splitlines())
    )


def test_a_proposal_is_a_comment_unless_it_is_asked_for(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(ROOT / "fixtures" / "parts" / "motor.dxf")
    assert main(["init", source]) == 0
    assert "as comments; --operations uses it" in capsys.readouterr().err
    text = (here / "motor.toml").read_text(encoding="utf-8")
    assert "operations" not in tables(here / "motor.toml")
    (here / "motor.toml").unlink()
    assert main(["init", source, "--operations"]) == 0
    asked = tables(here / "motor.toml")
    stock = {"thickness": 3.0, "below": 0.5, "margin": 16.0, "layer": "", "held": "frame"}
    assert asked["stock"] == stock
    proposed = uncommented(text)
    assert proposed == {"tools": asked["tools"], "operations": asked["operations"]}
    assert len(proposed["operations"]) == 7


@pytest.mark.usefixtures("built_once")
@pytest.mark.parametrize("file", FIXTURES, ids=lambda file: file.name)
def test_what_is_proposed_for_a_fixture_builds_as_it_is(file: Path, here: Path) -> None:
    assert main(["init", str(file), "--operations"]) == 0
    job = here / file.with_suffix(".toml").name
    assert tables(job)["operations"]
    assert main(["build", str(file), "--job", str(job), "--post", "gcode"]) == 0


@pytest.mark.usefixtures("built_once")
@pytest.mark.parametrize("name", SHARED)
def test_what_is_proposed_for_a_real_drawing_builds_as_it_is(
    name: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = SHARED_FOLDER / name
    if not file.is_file():
        pytest.skip(f"{name} of the folder shared/data beside the repository is absent")
    job = here / file.with_suffix(".toml").name
    if file.name in REFUSED:
        assert main(["init", str(file), "--operations"]) == 2
        assert REFUSED[file.name] in capsys.readouterr().err
        assert not job.exists()
        return
    assert main(["init", str(file), "--operations"]) == 0
    assert main(["build", str(file), "--job", str(job), "--post", "gcode"]) == 0


def test_what_has_no_closed_contour_has_no_operations(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = ezdxf.new("R2010", units=4)
    document.modelspace().add_line((0, 0), (10, 0))
    document.saveas(here / "line.dxf")
    assert main(["init", "line.dxf", "--operations"]) == 2
    said = capsys.readouterr().err
    assert (
        "line.dxf: has no closed contour that a drill or a mill could make (--operations)" in said
    )
    assert not (here / "line.toml").exists()
    assert main(["init", "line.dxf"]) == 0
    assert "proposed" not in capsys.readouterr().err


@pytest.mark.parametrize("name", ["rfa1.stl", "gear.png"])
def test_what_is_no_drawing_has_no_operations(
    name: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", str(ROOT / "fixtures" / "parts" / name), "--operations"]) == 2
    assert f"{name}: is not a flat drawing (--operations); leave it out" in capsys.readouterr().err
    assert not list(here.glob("*.toml"))


def test_many_ids_stand_on_several_lines(here: Path) -> None:
    """Slots and wide holes on one layer with what is drilled are chosen by their ids."""
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    for k in range(60):
        space.add_circle((30 * k, 0), 4 if k % 2 else 9)
    space.add_lwpolyline([(-30, -30), (1830, -30), (1830, 30), (-30, 30)], close=True)
    document.saveas(here / "row.dxf")
    assert main(["init", "row.dxf", "--operations"]) == 0
    text = (here / "row.toml").read_text(encoding="utf-8")
    proposed = text.partition("# Proposed")[2].partition("[post]")[0]
    assert max(map(len, proposed.splitlines())) <= 118
    assert [len(row.get("ids", [])) for row in tables(here / "row.toml")["operations"]] == [
        0,
        30,
        0,
    ]
