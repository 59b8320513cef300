"""Previews of a build: its view as a value, and the page, the pictures and the drawings of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from camgen.model.job import Job
from camgen.model.part import IntArray, Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.program import Program
from camgen.post import OutputFile, Post
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.collide import ClearanceReport
    from camgen.check.executed import Rounding
    from camgen.check.photo.locate import Located
    from camgen.check.reach import JointTrace
    from camgen.check.report import Cycle, Motions
    from camgen.check.stock import StockProof
    from camgen.collision.cell import CellScene
    from camgen.post.verify import Deviation


class Built(Protocol):
    """The part of a build's result that a preview needs (`camgen.pipeline.Result`)."""

    @property
    def part(self) -> Part: ...  # noqa: D102 (as in Result)
    @property
    def job(self) -> Job: ...  # noqa: D102
    @property
    def post(self) -> Post: ...  # noqa: D102
    @property
    def cell(self) -> Workcell: ...  # noqa: D102
    @property
    def tour(self) -> Tour: ...  # noqa: D102
    @property
    def planned(self) -> tuple[ToolPath, ...]: ...  # noqa: D102
    @property
    def notes(self) -> tuple[Note, ...]: ...  # noqa: D102
    @property
    def program(self) -> Program: ...  # noqa: D102
    @property
    def files(self) -> tuple[OutputFile, ...]: ...  # noqa: D102
    @property
    def lines(self) -> IntArray: ...  # noqa: D102
    @property
    def deviation(self) -> Deviation: ...  # noqa: D102
    @property
    def motions(self) -> Motions: ...  # noqa: D102
    @property
    def cycle(self) -> Cycle: ...  # noqa: D102
    @property
    def reach(self) -> JointTrace | None: ...  # noqa: D102
    @property
    def clear(self) -> ClearanceReport | None: ...  # noqa: D102
    @property
    def proof(self) -> StockProof | None: ...  # noqa: D102
    @property
    def rounded(self) -> Rounding | None: ...  # noqa: D102
    @property
    def where(self) -> CellScene | None: ...  # noqa: D102
    @property
    def located(self) -> Located | None: ...  # noqa: D102
    @property
    def blocked(self) -> tuple[ToolPath, ...]: ...  # noqa: D102


def list_seen(result: Built) -> list[FloatArray]:
    """The closed outlines (N, 2), mm, in the photo that places the part."""
    if result.located is None:
        return []
    from shapely import boundary, get_coordinates, get_parts  # noqa: PLC0415 (only for photos)

    return list(map(get_coordinates, get_parts(boundary(result.located.inspection.seen))))
