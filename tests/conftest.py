import gc
import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.remembered import prove_once

# The command line sets this, too: more threads of linear algebra slow each other down if each core
# already runs tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: Number of examples of a property without `@settings` of its own, by day and by night.
FEW, MANY = 25, 500
# There is no deadline, because a busy machine needs more time for an example. CI tries the same
# examples in each run, so that a failure can be repeated. At a desk each run tries new examples.
# `pytest --hypothesis-profile=nightly` tries many new examples.
settings.register_profile("desk", deadline=None, max_examples=FEW)
settings.register_profile("ci", deadline=None, max_examples=FEW, derandomize=True, database=None)
settings.register_profile("nightly", deadline=None, max_examples=MANY)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores for `-n auto`, as some tests wait for a browser or a process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)) + 1
    return (os.cpu_count() or 1) + 1


def pytest_sessionstart() -> None:
    """Switches the garbage collector off during collection, as nearly all objects stay."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Excludes the collected tests from the garbage collector, which they would slow down."""
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
