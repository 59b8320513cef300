"""The pen never marks on the way between two lines: judged on what every controller's text says, read back."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camgen.geometry.arcs import measure_path
from camgen.lower import lower
from camgen.model.errors import NoSafeProgram
from camgen.model.part import Contour, Part
from camgen.model.pose import Pose, frozen
from camgen.model.program import MoveC, MoveJ, MoveL, Output
from camgen.order.arrange import TourSettings, order_paths
from camgen.pipeline import build
from camgen.plan.trace import trace
from camgen.post.plugins import find_post, find_readback, make_post
from camgen.post.verify import compare
from camgen.read.job_file import from_mapping
from camgen.robots.workcell import equip_cell

POSTS = ("gcode", "grbl", "pacscript", "rapid", "vplus")
#: By signal and height, by height alone, with pressure, by signal alone on a clearance of a hair.
WAYS = (
    {"signal": "process", "dwell": 0.1},
    {"signal": ""},
    {"force": 2.0},
    {"signal": "process", "clearance": 0.5, "approach": 0.0},
)
points = st.lists(
    st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=2, max_size=5, unique=True
)
drawings = st.lists(st.tuples(points, st.booleans(), st.booleans()), min_size=1, max_size=5)


def part_of(drawing: list[tuple[list[tuple[int, int]], bool, bool]]) -> Part:
    contours = []
    for k, (corners, closed, curved) in enumerate(drawing, 1):
        bulges = np.full(len(corners), 0.3 if curved else 0.0)
        points = frozen([[x, y + 90.0 * k] for x, y in corners])
        contours.append(Contour(points, frozen(bulges), closed and len(corners) > 2, "0", f"c{k}"))
    return Part("drawing", "drawing.svg", "mm", tuple(contours), ())


#: Nearer to the paper than this (mm) the pen touches it; the finest text has three digits.
TOUCH = 2e-3


def lengths_of(body: tuple[object, ...], signal: str | None, air: bool) -> tuple[float, float]:
    """The length that the pen draws, and the number of times it travels; fails where it might mark elsewhere.

    signal: its name, None where height alone decides. air: it is switched above the paper, as with pressure.
    """
    drawn, travels, on, at = 0.0, 0, signal is None, None
    motions = [one for one in body if isinstance(one, (MoveJ, MoveL, MoveC, Output))]
    for k, one in enumerate(motions):
        if isinstance(one, Output):
            if one.signal == signal and at is None:
                assert one.value == 0, "the signal is on before the first motion"
            elif one.signal == signal:
                on = one.value > 0
                assert (abs(at[2]) < TOUCH) != air, (
                    "the signal changes in the air, or with pressure on the paper"
                )
            continue
        place = np.array(one.target.origin) if isinstance(one.target, Pose) else None
        if at is not None and place is not None:
            across = float(np.hypot(*(place - at)[:2]))
            down = min(at[2], place[2])
            if across > TOUCH and down < TOUCH:
                assert on, "the pen is on the paper with its signal off"
                assert max(at[2], place[2]) < TOUCH, "the pen slides up or down"
                drawn += (
                    arc_length(at, one)
                    if isinstance(one, MoveC)
                    else float(np.hypot(*(place - at)[:2]))
                )
            elif across > TOUCH:
                assert signal is None or not on, "the signal is on in the air"
                travels += 1
            following = next((m for m in motions[k + 1 :] if not isinstance(m, Output)), None)
            leaves = (
                following is not None
                and isinstance(following.target, Pose)
                and following.target.origin[2] > TOUCH
            )
            if place[2] < TOUCH and (at[2] > TOUCH or leaves):
                assert one.blend == 0, "a corner between paper and air is rounded"
        else:
            assert signal is None or not on
        at = place
    assert signal is None or not on, "the pen stays on"
    return drawn, travels


def arc_length(start: np.ndarray, arc: MoveC) -> float:
    chord = np.linalg.norm(np.array(arc.target.origin) - start)
    half = np.linalg.norm(np.array(arc.via.origin) - start)
    quarter = np.arccos(min(1.0, float(chord / (2 * half))))
    return float(2 * half * quarter / np.sin(quarter)) if quarter > 1e-6 else float(chord)


@pytest.mark.parametrize("name", POSTS)
@settings(max_examples=20)
@given(drawing=drawings, way=st.sampled_from(WAYS))
def test_the_pen_is_up_on_the_way_between_lines(
    name: str, drawing: list[tuple[list[tuple[int, int]], bool, bool]], way: dict[str, object]
) -> None:
    # Controllers that have no force, or say it in their own words, are asked to leave it out.
    options = (
        {"force": "ignore"}
        if "force" in way and "force" in vars(make_post(find_post(name), {}))
        else {}
    )
    job = from_mapping({"operation": {"kind": "trace"}, "process": way, "post": options})
    part = part_of(drawing)
    post = make_post(find_post(name), job.post)
    tour = order_paths(trace(part, job), TourSettings("nearest", None, False))
    program = post.prepare(
        lower(tour, equip_cell(post.cell(), job), job, "drawing", ()), job.tolerance.chord
    )
    files = post.render(program)
    reading = find_readback(name)({file.name: file.text for file in files}, job.post)
    compare(program, reading, post.tolerance(), post.list_verified(), files[0].name)
    drawn, travelled = lengths_of(
        reading.body, None if way.get("signal") == "" else "process", "force" in way
    )
    assert drawn == pytest.approx(
        sum(measure_path(path) for path in tour.paths), rel=1e-3, abs=0.05
    )
    assert travelled >= len(tour.paths) - 1 or way.get("clearance") == 0.5


def test_a_drawing_out_of_the_reach_of_the_scara_is_refused_with_path_and_place(
    tmp_path: Path,
) -> None:
    source = tmp_path / "line.svg"
    line = '<path d="M10 10H190V190H10Z"/>'
    source.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="200mm" viewBox="0 0 200 200">{line}</svg>'
    )
    job = {"page": {"size": "A4"}, "cell": {"robot": "Cobra s600"}}
    built = build(source, post="vplus", job=job)
    assert built.reach is not None
    with pytest.raises(NoSafeProgram) as error:
        build(source, post="vplus", job={**job, "page": {"size": "A0"}})
    assert error.value.exit_code == 3
    assert "path c1" in str(error.value)
