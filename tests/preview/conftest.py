"""A browser for the tests of a module, two at once do not go together; and a part that many of them show."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import camgen
from camgen.pipeline import Result
from tests.support.browsers import Driven, start_browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Driven]:
    with start_browser() as opened:
        yield opened


@pytest.fixture(scope="session")
def solid() -> Result:
    """A 3-D part with an arm, some of whose edges are not run."""
    return camgen.build(Path(__file__).parents[2] / "fixtures" / "parts" / "rfa1.stl", post="rapid")
