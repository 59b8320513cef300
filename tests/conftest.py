import gc
import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.remembered import prove_once

# As the command line does: threads of linear algebra take each other's time where every core runs tests already.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: Examples of a property, where its own ``@settings`` does not ask for fewer.
FEW, MANY = 25, 500
# No deadline: the time of an example depends on what else the machine does. In CI each run tries
# the same examples, so that a failure can be run again. At a desk new ones are tried each time.
# ``pytest --hypothesis-profile=nightly`` tries many new ones.
settings.register_profile("desk", deadline=None, max_examples=FEW)
settings.register_profile("ci", deadline=None, max_examples=FEW, derandomize=True, database=None)
settings.register_profile("nightly", deadline=None, max_examples=MANY)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


def pytest_sessionstart() -> None:
    """Search for no cyclic garbage while tests are collected: nearly all that is made stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Keep the tests themselves out of each search for cyclic garbage, which they make slower."""
    gc.freeze()
    gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--accept", action="store_true", help="rewrite the expected programs of fixtures/cases"
    )


@pytest.fixture(scope="module", autouse=True)
def one_proof_of_a_tour(request: pytest.FixtureRequest) -> Iterator[None]:
    """Builds of the same paths share the proof of their tour, except in the tests of orders."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.path.is_relative_to(Path(__file__).parent / "order"):
            patch.setattr(import_module("camgen.order.arrange"), "improve_few", prove_once())
        yield


@pytest.fixture
def accept(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--accept"))
