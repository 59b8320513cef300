"""The public names of the package: the stages called one by one, parts made in code, values."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from msgspec.structs import replace

import camgen

PARTS = Path(__file__).parents[1] / "fixtures" / "parts"
JOB = {"tool": {"diameter": 4.0}, "operation": {"lead_in": 2.0}}


@pytest.mark.parametrize(("source", "job"), [("bracket.dxf", JOB), ("rfa1.stl", {})])
def test_the_stages_called_in_turn_give_the_result_of_build(
    source: str, job: dict[str, object]
) -> None:
    result = camgen.build(PARTS / source, post="rapid", job=job)
    part = camgen.read(PARTS / source, job)
    plan = camgen.plan(part, job, "rapid")
    cell = camgen.cell("rapid", job, part)
    tour = camgen.order(plan, job, cell)
    program = camgen.lower(tour, job, cell, part.name, result.program.header)
    checks = camgen.check(program, job, cell, plan)
    files = camgen.post(checks.program, "rapid", job)
    assert [file.text for file in files] == [file.text for file in result.files]
    assert camgen.verify(files, checks.program, "rapid", job) == result.deviation
    assert not camgen.read_back(files, "rapid", job).findings


def test_a_text_with_another_number_is_refused() -> None:
    tour = camgen.order(camgen.plan(camgen.part([(0, 0), (40, 0), (40, 20), (0, 0)])))
    program = camgen.lower(tour, cell="gcode")
    (file,) = camgen.post(program, "gcode")
    assert camgen.verify([file], program, "gcode").max_mm < 1e-3
    changed = {file.name: file.text.replace("X43", "X44", 1)}
    assert changed[file.name] != file.text
    with pytest.raises(camgen.VerifyError):
        camgen.verify([type(file)(file.name, changed[file.name])], program, "gcode")


SQUARE = [(0, 0), (40, 0), (40, 30), (0, 30), (0, 0)]
OTHER = [*SQUARE[:3], (0, 31), (0, 0)]


@pytest.mark.parametrize(
    ("shape", "closed", "points"),
    [
        (SQUARE, [True], [4]),
        (np.array(SQUARE, dtype=float), [True], [4]),
        (SQUARE[:4], [False], [4]),
        ([SQUARE, [(5, 5), (9, 9)]], [True, False], [4, 2]),
        (shapely.box(0, 0, 40, 30).difference(shapely.box(10, 10, 20, 20)), [True, True], [4, 4]),
        (
            shapely.MultiLineString([[(0, 0), (1, 1)], [(2, 2), (3, 3), (3, 3), (4, 5)]]),
            [False, False],
            [2, 3],
        ),
        (camgen.Contour(np.array([[0.0, 0], [10, 0]]), np.ones(2), True, "holes"), [True], [2]),
    ],
)
def test_a_part_is_made_of_points_and_shapes(
    shape: object, closed: list[bool], points: list[int]
) -> None:
    part = camgen.part(shape)
    assert [contour.closed for contour in part.contours] == closed
    assert [len(contour.points) for contour in part.contours] == points
    assert [contour.id for contour in part.contours] == [f"c{k}" for k in range(1, len(closed) + 1)]


def test_the_path_of_a_part_made_in_code_has_its_length() -> None:
    result = camgen.build(camgen.part(SQUARE), post="gcode", job={"operation": {"kind": "trace"}})
    assert result.report["tour"]["work_mm"] == pytest.approx(140.0)  # type: ignore[index]


def test_a_part_is_made_of_a_mesh() -> None:
    part = camgen.part(trimesh.creation.box((40, 30, 20)), "block")
    assert part.solid is not None
    assert sorted(edge.length for edge in part.solid.edges) == pytest.approx(
        [20.0] * 4 + [30.0] * 4 + [40.0] * 4
    )
    assert all(edge.convex for edge in part.solid.edges)


@pytest.mark.parametrize(
    "shape", [[], "square", 7, shapely.Point(1, 2), [(0, 0), (float("nan"), 1)], [(1, 1), (1, 1)]]
)
def test_values_that_are_not_shapes_are_refused(shape: object) -> None:
    with pytest.raises(camgen.InputError):
        camgen.part(shape)


def test_equal_parts_have_equal_digests_and_other_parts_have_others() -> None:
    first, second, other = (
        camgen.build(camgen.part(s), post="gcode").text for s in (SQUARE, SQUARE, OTHER)
    )
    assert first == second
    digests = [re.findall(r"job ([0-9a-f]{12})", text) for text in (first, other)]
    assert digests[0] != digests[1]
    assert [len(digest) for digest in digests] == [1, 1]


def test_dir_shows_all_names() -> None:
    assert set(dir(camgen)) == set(camgen.__all__)
    for name in camgen.__all__:
        assert getattr(camgen, name) is not None
    with pytest.raises(AttributeError):
        camgen.nothing  # noqa: B018


def test_a_stage_stays_a_function_after_the_import_of_its_folder() -> None:
    code = (
        "import camgen, camgen.plan, camgen.read.dxf, camgen.pipeline.stages\n"
        "from camgen.order import order\n"
        "print(camgen.plan.__module__, camgen.read.__module__, "
        "camgen.order.__module__, callable(camgen.build))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert out.split() == ["camgen.pipeline.stages"] * 3 + ["True"]


def test_values_have_a_short_repr_and_a_drawing() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="rapid")
    solid = camgen.read(PARTS / "rfa1.stl")
    values = [
        result.part,
        *result.part.contours,
        result.tour,
        *result.tour.paths,
        result.program,
        result,
        solid,
    ]
    assert all(len(repr(value)) < 100 for value in values)
    assert repr(result.part).startswith("Part('bracket', ")
    for drawn in (result.part, result.tour, result, solid):
        svg = drawn._repr_svg_()
        assert svg is not None
        assert svg.startswith("<svg ")
        assert "nan" not in svg
        assert svg.count("<path") > 0


def test_the_import_of_the_package_loads_no_large_library() -> None:
    code = (
        "import camgen, sys; "
        "print([m for m in ('numpy', 'cv2', 'ezdxf', 'shapely', 'msgspec') if m in sys.modules])"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout == "[]\n"


def test_the_cell_of_a_program_is_not_guessed() -> None:
    tour = camgen.order(camgen.plan(camgen.part(SQUARE)))
    for stage in (camgen.lower, camgen.check):
        with pytest.raises(
            camgen.JobError, match=r"cell: is not given; give a result of camgen\.cell"
        ):
            stage(tour if stage is camgen.lower else camgen.lower(tour, cell="gcode"))


def test_changed_paths_of_edges_are_refused_and_those_of_drawings_run() -> None:
    plan = camgen.plan(camgen.read(PARTS / "rfa1.stl"), {}, "rapid")
    with pytest.raises(camgen.JobError, match="follow from the job"):
        camgen.order(replace(plan, paths=plan.paths[:1]), {}, camgen.cell("rapid", {}, plan.part))
    flat = camgen.plan(camgen.part([SQUARE, [(60, 0), (90, 0), (90, 9), (60, 0)]]))
    assert len(camgen.order(replace(flat, paths=flat.paths[:1])).paths) == 1


def test_notes_of_the_reader_stay_if_an_operation_drops_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from camgen.plan import operations  # noqa: PLC0415 (patched here only)

    part = replace(camgen.part(SQUARE), notes=(camgen.Note("skipped", "3 TEXT", "no curves"),))
    original_plan = operations.FOLLOW.plan
    silent = replace(
        operations.FOLLOW, plan=lambda *given: replace(original_plan(*given), notes=())
    )
    monkeypatch.setattr(operations, "FOLLOW", silent)
    assert camgen.plan(part).notes == part.notes
