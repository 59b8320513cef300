"""One browser for all tests of pages."""

from collections.abc import Iterator

import pytest

from tests.support.browsers import Driven, start_browser


@pytest.fixture(scope="package")
def browser() -> Iterator[Driven]:
    with start_browser() as opened:
        yield opened
