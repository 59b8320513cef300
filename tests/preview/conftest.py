"""A browser for the tests of a module: two at once do not go together."""

from collections.abc import Iterator

import pytest

from tests.support.browsers import Driven, start_browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Driven]:
    with start_browser() as opened:
        yield opened
