"""A program that ``camgen verify`` holds against a drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from camgen.lang.programs import Executed
from camgen.model.cell import Dynamics
from camgen.post import Post

if TYPE_CHECKING:
    from camgen.geometry.fixtures import Fixtures


class Proven(NamedTuple):
    """A program that is held against a drawing.

    executed: run of its text.
    post: the post of a program of ours, None for any other.
    dynamics: dynamics of its controller; None if its way to round corners is not known.
    on_arm: whether an arm runs it.
    states_job: whether the header of the text names its job, whose feeds and speeds it then has.
    fixtures: fixtures of a mill, None for none and for an arm.
    """

    executed: Executed
    post: Post | None = None
    dynamics: Dynamics | None = None
    on_arm: bool = False
    states_job: bool = False
    fixtures: Fixtures | None = None
