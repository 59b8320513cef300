"""Pockets with corners and necks that a large tool leaves and a small one clears."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely

import camgen
from bench.plan.pockets import shapes
from camgen.cli import main
from camgen.model.errors import VerifyError
from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath
from camgen.pipeline import Result
from camgen.plan import JobPlan
from camgen.plan.pocket import rest
from camgen.plan.rest import find_rest
from tests.support.drawn import circle, contour, rectangle
from tests.support.swept import enclosed, reachable, swept

LARGE, SMALL = 3.0, 1.0
#: Two areas with a neck of 4 mm, which the large mill cannot enter.
ROOMS = [
    *((0, 0), (30, 0), (30, 18), (50, 18), (50, 0), (80, 0)),
    *((80, 40), (50, 40), (50, 22), (30, 22), (30, 40), (0, 40)),
]
#: Strips in which an earlier tool leaves no more than this, mm, stay (docs/follow.md).
LEFT_MM = 0.02


def make_job(*rows: dict[str, Any], **common: Any) -> dict[str, Any]:
    """Pockets with tools of 6 and 2 mm. Without rows the small tool clears the rest material."""
    pocket = {"kind": "pocket", "depth": 3.0, "entry": "ramp", **common}
    given = rows or ({"tool": "large"}, {"tool": "small", "rest": True})
    return {
        "stock": {"thickness": 6.0},
        "tools": [
            {"name": "large", "number": 1, "diameter": 2 * LARGE, "speed": 9000.0},
            {"name": "small", "number": 2, "diameter": 2 * SMALL, "speed": 9000.0},
        ],
        "operations": [{**pocket, **row} for row in given],
    }


def make_part(*contours: Contour) -> Part:
    return Part("part", "part.dxf", "mm", contours, ())


def plan(part: Part, **common: Any) -> tuple[list[ToolPath], list[ToolPath]]:
    """The paths of the large tool and of the small one."""
    job_plan = camgen.plan(part, make_job(**common))
    assert isinstance(job_plan, JobPlan)
    large, small = (job_plan.plans[job_plan.numbers.index(number)] for number in (0, 1))
    return list(large.paths), list(small.paths)


def build(part: Part, **common: Any) -> Result:
    return camgen.build(part, post="gcode", job=make_job(**common))


def measure_left(result: Result) -> tuple[float, float]:
    """Area that inner corners explain at the floor of the pockets, and other area, mm2."""
    assert result.proof is not None
    (floor,) = [level for level in result.proof.levels if level.bottom < -2.9 < level.top]
    return floor.excess.corners, floor.excess.unexplained.area


PARTS: dict[str, Callable[[], Part]] = {
    "window": lambda: make_part(rectangle(0, 0, 60, 40, "w")),
    "sharp": lambda: make_part(contour([(0, 0), (36, 4), (14, 11), (32, 28), (4, 21)], name="w")),
    "rooms": lambda: make_part(contour(ROOMS, name="w")),
    "island": lambda: make_part(rectangle(0, 0, 42, 28, "w"), circle(13, 14, 6, "i")),
    "arcs and islands": lambda: shapes(13),
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("finish", [0.0, 0.2])
def test_both_tools_together_clear_all_that_the_small_one_reaches(name: str, finish: float) -> None:
    part = PARTS[name]()
    large, small = plan(part, finish=finish)
    region = enclosed(part.contours)
    first, second = swept(large, LARGE), swept(small, SMALL)
    bare = reachable(region, SMALL) - first - second
    assert bare.buffer(-LEFT_MM / 2).is_empty
    assert second.difference(region.buffer(0.005)).is_empty
    # The small tool stays within about its diameter of the rest material.
    left = reachable(region, SMALL) - first
    assert second.difference(left.buffer(2.1 * 2 * SMALL)).is_empty
    assert {path.contours for path in small} <= {path.contours for path in large}


def test_the_corners_have_the_rest_material_of_the_small_tool() -> None:
    part = PARTS["window"]()
    corners, other = measure_left(build(part))
    assert corners == pytest.approx((4 - math.pi) * SMALL**2, abs=0.02)
    assert other == 0
    job = make_job({"tool": "large"})
    corners, _ = measure_left(camgen.build(part, post="gcode", job=job))
    assert corners == pytest.approx((4 - math.pi) * LARGE**2, abs=0.05)


@pytest.mark.parametrize(
    "settings",
    [{}, {"passes": 2, "finish": 0.2}, {"entry": "helix"}, {"engagement": 1.0}],
    ids=["ramp", "finish", "helix", "no bound"],
)
@pytest.mark.parametrize("name", ["sharp", "island"])
def test_the_motions_of_the_text_are_proven(name: str, settings: dict[str, Any]) -> None:
    result = build(PARTS[name](), **settings)
    assert result.motion is not None
    assert (result.motion.findings, result.motion.unproven) == ((), ())
    assert measure_left(result)[1] == 0


def test_a_note_names_a_round_pocket_without_rest_material() -> None:
    part = make_part(rectangle(0, 0, 30, 30, "window"), circle(70, 30, 10, "round"))
    result = build(part)
    small = [path for path in result.planned if path.id.startswith("1:")]
    assert {path.contours for path in small} == {("window",)}
    assert any("nothing is left of 1 pocket: round" in note.what for note in result.notes)
    assert result.motion is not None
    assert result.motion.findings == ()
    result = build(make_part(circle(70, 30, 10, "round")))
    assert all(path.id.startswith("0:") for path in result.planned)
    assert result.motion is not None
    assert result.motion.findings == ()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            [{"tool": "small", "rest": True}, {"tool": "large"}],
            "no operation before it takes anything",
        ),
        (
            [{"tool": "small"}, {"tool": "small", "rest": True}],
            "no operation before it has a larger tool",
        ),
        ([{"tool": "large", "rest": True}], "no operation before it takes anything"),
    ],
)
def test_a_rest_needs_a_larger_tool_before_it(rows: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(camgen.JobError, match=message) as error:
        camgen.build(PARTS["window"](), post="gcode", job=make_job(*rows))
    assert (error.value.where, error.value.exit_code) == ("operation.rest", 2)


def test_a_shallow_operation_leaves_all_of_a_deeper_pocket() -> None:
    rows = {"tool": "large", "depth": 2.0}, {"tool": "small", "rest": True}
    job_plan = camgen.plan(PARTS["window"](), make_job(*rows))
    region = shapely.box(0, 0, 60, 40)
    assert isinstance(job_plan, JobPlan)
    small = swept(job_plan.plans[job_plan.numbers.index(1)].paths, SMALL)
    assert (reachable(region, SMALL) - small).buffer(-0.005).is_empty


def test_a_corner_that_the_plan_forgets_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The proof of motion finds places that neither tool clears, without the plan."""
    corner = shapely.box(50, 30, 60, 40)

    def forget(*given: Any) -> Any:
        return shapely.difference(find_rest(*given), corner)

    monkeypatch.setattr(rest, "find_rest", forget)
    with pytest.raises(VerifyError, match=r"is not cleared at 59.* which the tool can reach"):
        build(PARTS["window"]())


def test_a_corner_that_is_missing_in_the_text_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="80mm" viewBox="0 0 100 80">'
        '<rect x="20" y="20" width="60" height="40"/></svg>'
    )
    (tmp_path / "part.toml").write_text(
        "[stock]\nthickness = 6.0\n"
        '[[tools]]\nname = "large"\nnumber = 1\ndiameter = 6.0\nspeed = 9000.0\n'
        '[[tools]]\nname = "small"\nnumber = 2\ndiameter = 2.0\nspeed = 9000.0\n'
        '[[operations]]\nkind = "pocket"\ntool = "large"\ndepth = 3.0\nentry = "ramp"\n'
        '[[operations]]\nkind = "pocket"\ntool = "small"\nrest = true\ndepth = 3.0\n'
        'entry = "ramp"\n'
    )
    words = ["part.ngc", "--post", "gcode", "--part", "part.svg", "--job", "part.toml"]
    assert main(["build", "part.svg", "--post", "gcode", "-q"]) == 0
    assert main(["verify", *words]) == 0
    assert "mm2 else" not in capsys.readouterr().out
    text = (tmp_path / "part.ngc").read_text()
    *kept, last = text.split("(path 1:")
    assert len(kept) == 4
    (tmp_path / "part.ngc").write_text("(path 1:".join(kept) + last[last.index("M5") :])
    main(["verify", *words])
    assert "mm2 else, up to 0.8" in capsys.readouterr().out
