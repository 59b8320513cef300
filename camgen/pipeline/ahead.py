"""Loads the modules of later stages, for a thread beside one that leaves Python idle."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module

#: Modules that nearly every build of contours from a picture needs.
_MODULES = (
    "numpy.ma",  # by np.median
    "yaml",
    "camgen.plan.follow",
    "camgen.order.arrange",
    "camgen.order.leads",
    "camgen.order.tabs",
    "camgen.check.proof.flat",
)


def load_later_stages(post: str) -> None:
    """Load what plans, orders and proves, and the read-back of `post` if it is built in."""
    for name in (*_MODULES, f"camgen.lang.{post}.strict"):
        with suppress(ImportError):  # the stage that needs it reports it
            import_module(name)
