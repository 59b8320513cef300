"""The advice to run `camgen place` is removed from the texts that give it."""

import pytest

from camgen.model.advice import ANOTHER_PLACE, drop_place


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        (f"no tilt helps: {ANOTHER_PLACE} may", "no tilt helps"),
        (f"no tilt helps: {ANOTHER_PLACE} may; and more", "no tilt helps; and more"),
        (
            f"it collides; cell.safety or {ANOTHER_PLACE} may help",
            "it collides; cell.safety may help",
        ),
        (
            f"nothing leads to it: {ANOTHER_PLACE}, clearance or home may help",
            "nothing leads to it: clearance or home may help",
        ),
        ("out of reach by 3 mm", "out of reach by 3 mm"),
    ],
)
def test_the_rest_of_a_text_stays(text: str, rest: str) -> None:
    assert drop_place(text) == rest
