"""Robot programs posted for another controller and back: the same motion (docs/translate.md)."""

from itertools import permutations

import pytest

from bench.read.translate import CASES, POSTS, WITHIN, apart, there_and_back


@pytest.mark.parametrize("case", ["bracket-robot", "layers-inside", "space-trace"])
@pytest.mark.parametrize(("source", "target"), list(permutations(POSTS, 2)))
def test_there_and_back_is_the_same_motion(case: str, source: str, target: str) -> None:
    file = CASES / case / "expected" / f"part{POSTS[source][0]}"
    if not file.exists():
        pytest.skip(f"{case} has no program for {source}")
    before, after = there_and_back(file, source, target)
    assert len(before.points) > 100
    assert apart(before, after) < WITHIN
    assert before.seconds == pytest.approx(after.seconds, rel=2e-3, abs=2e-3)
    assert [value for _, value in before.outputs] == [value for _, value in after.outputs]
