"""The browser of a module, and a 3-D part that many tests show.

Two browsers of Playwright cannot run at once in one process: each module opens and closes its own.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

import camgen
from camgen.pipeline import Result
from tests.support.browsers import Driven, start_browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Driven]:
    """A browser without a window."""
    with start_browser() as opened:
        yield opened


@pytest.fixture(scope="session")
def solid() -> Result:
    """The result for a 3-D part with an arm, which does not run all of its edges."""
    return camgen.build(Path(__file__).parents[2] / "fixtures" / "parts" / "rfa1.stl", post="rapid")
