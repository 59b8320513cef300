"""PacScript: the fast path of the read-back for lines, reorientations and templates of force."""

import pytest

from camgen.lang.columns import Run
from camgen.model.program import Force, MoveL
from tests.post.fast_paths.pacscript import BY_HAND, PATH, TURNING, list_within_motions


def test_the_fast_path_takes_the_motions_around_another_spelling() -> None:
    text, _ = next(list_within_motions("1.0"))
    assert text.endswith("\nEnd Sub")
    assert PATH.count_fast(text) >= 4


def test_the_fast_path_takes_reorientations() -> None:
    """Each of the five pieces starts with two: 1 and 0.5 rad/s are 11.4592 and 5.7296 %."""
    turns = (", Speed = 11.4592\n", ", Speed = 5.7296\n")
    assert TURNING.count(turns[0]) == TURNING.count(turns[1]) == 5
    lines = [item for item in PATH.check(TURNING, {}).body if isinstance(item, MoveL)]
    speeds = [line.turn for line in lines if line.turn]
    assert speeds == pytest.approx([1.0, 0.5] * 5, abs=1e-5)
    runs = [piece for piece in PATH.template.cut(TURNING) if isinstance(piece, Run)]
    usual = "".join(run.source.text for run in runs)
    assert sum(usual.count(turn) for turn in turns) == 10


@pytest.mark.parametrize(
    ("template", "line"),
    [
        ("{n} {x} {y} {z}", "2 3.0 4.0 0"),
        ("{n}{x}{y}{z}", "-2+3.0 -4.0+0"),
        ("PRESS {n} {x} {y} {z}", "press 2 3.0 4.0 0"),
        (" * {n} {x} {y} {z}", "*2 3.0 4.0 0"),
        ("ſtop {n} {x} {y} {z}", "Stop 2 3.0 4.0 0"),
        ("Stop {n} {x} {y} {z}", "ſtop 2 3.0 4.0 0"),
        ("{n} {x} {y} {z}", "٢ 3.0 4.0 0"),
    ],
)
def test_a_line_of_a_template_is_found_by_its_first_character(template: str, line: str) -> None:
    text = BY_HAND.replace("    ForceCtrl True, 1\n", f"    {line}\n")
    assert text != BY_HAND
    reading = PATH.check(text, {"force_on": [template]})
    (force, _) = (item for item in reading.body if isinstance(item, Force))
    assert force.newtons == pytest.approx(5.0)
