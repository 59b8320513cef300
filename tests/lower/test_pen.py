"""A pen never marks on a link. The readings of the texts of all controllers are tested."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camgen.geometry.arcs import measure_path
from camgen.lower import lower
from camgen.model.errors import NoSafeProgram
from camgen.model.job import TourTable
from camgen.model.part import Contour, Part
from camgen.model.pose import Pose, frozen
from camgen.model.program import MoveC, MoveJ, MoveL, Output
from camgen.order.arrange import order_paths
from camgen.pipeline import build
from camgen.plan.trace import trace
from camgen.post.plugins import find_post, find_readback, make_post
from camgen.post.verify import compare
from camgen.read.job_file import from_mapping
from camgen.robots.workcell import equip_cell

POSTS = ("gcode", "grbl", "pacscript", "rapid", "vplus")
#: A pen works by signal and height, by height alone, by force, or at a clearance of 0.5 mm.
PROCESSES = (
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


#: Distance from the paper at which the pen touches it, mm. Coordinates are printed to 0.001 mm.
TOUCH = 2e-3


def lengths_of(body: tuple[object, ...], signal: str | None, air: bool) -> tuple[float, float]:
    """The length that the pen draws, mm, and the number of links. Fails if the pen may mark a link.

    signal: name of the signal, None if the pen works by height alone.
    air: the signal is switched above the paper, as with a force.
    """
    drawn, travels, on, at = 0.0, 0, signal is None, None
    motions = [item for item in body if isinstance(item, (MoveJ, MoveL, MoveC, Output))]
    for k, item in enumerate(motions):
        if isinstance(item, Output):
            if item.signal == signal and at is None:
                assert item.value == 0, "the signal is on before the first motion"
            elif item.signal == signal:
                on = item.value > 0
                assert (abs(at[2]) < TOUCH) != air, (
                    "the signal changes in the air, or with pressure on the paper"
                )
            continue
        place = np.array(item.target.origin) if isinstance(item.target, Pose) else None
        if at is not None and place is not None:
            across = float(np.hypot(*(place - at)[:2]))
            down = min(at[2], place[2])
            if across > TOUCH and down < TOUCH:
                assert on, "the pen is on the paper with its signal off"
                assert max(at[2], place[2]) < TOUCH, "the pen slides up or down"
                drawn += arc_length(at, item) if isinstance(item, MoveC) else across
            elif across > TOUCH:
                assert signal is None or not on, "the signal is on in the air"
                travels += 1
            following = next((m for m in motions[k + 1 :] if not isinstance(m, Output)), None)
            to_pose = following is not None and isinstance(following.target, Pose)
            leaves = to_pose and following.target.origin[2] > TOUCH
            if place[2] < TOUCH and (at[2] > TOUCH or leaves):
                assert item.blend == 0, "a corner between paper and air is rounded"
        else:
            assert signal is None or not on
        at = place
    assert signal is None or not on, "the pen stays on"
    return drawn, travels


def arc_length(start: np.ndarray, arc: MoveC) -> float:
    """Length of an arc from its chord and the chord of its half, mm."""
    chord = np.linalg.norm(np.array(arc.target.origin) - start)
    half = np.linalg.norm(np.array(arc.via.origin) - start)
    quarter = np.arccos(min(1.0, float(chord / (2 * half))))
    return float(2 * half * quarter / np.sin(quarter)) if quarter > 1e-6 else float(chord)


@pytest.mark.parametrize("name", POSTS)
@settings(max_examples=20)
@given(drawing=drawings, process=st.sampled_from(PROCESSES))
def test_the_pen_does_not_mark_on_links(
    name: str, drawing: list[tuple[list[tuple[int, int]], bool, bool]], process: dict[str, object]
) -> None:
    # Posts that print no force, or by a template only, leave it out by an option.
    has_option = "force" in vars(make_post(find_post(name), {}))
    options = {"force": "ignore"} if "force" in process and has_option else {}
    job = from_mapping({"operation": {"kind": "trace"}, "process": process, "post": options})
    part = part_of(drawing)
    post = make_post(find_post(name), job.post)
    tour = order_paths(trace(part, job), TourTable("nearest"), None, False)
    program = post.prepare(
        lower(tour, equip_cell(post.cell(), job), job, "drawing", ()), job.tolerance.chord
    )
    files = post.render(program)
    reading = find_readback(name)({file.name: file.text for file in files}, job.post)
    compare(program, reading, post.tolerance(), post.list_verified(), files[0].name)
    signal = None if process.get("signal") == "" else "process"
    drawn, travels = lengths_of(reading.body, signal, "force" in process)
    planned = sum(measure_path(path) for path in tour.paths)
    assert drawn == pytest.approx(planned, rel=1e-3, abs=0.05)
    assert travels >= len(tour.paths) - 1 or process.get("clearance") == 0.5


def test_a_drawing_out_of_reach_is_refused_with_its_path(
    tmp_path: Path,
) -> None:
    source = tmp_path / "line.svg"
    line = '<path d="M10 10H190V190H10Z"/>'
    source.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="200mm" viewBox="0 '
        f'0 200 200">{line}</svg>'
    )
    job = {"page": {"size": "A4"}, "cell": {"robot": "Cobra s600"}}
    built = build(source, post="vplus", job=job)
    assert built.reach is not None
    with pytest.raises(NoSafeProgram) as error:
        build(source, post="vplus", job={**job, "page": {"size": "A0"}})
    assert error.value.exit_code == 3
    assert "path c1" in str(error.value)
