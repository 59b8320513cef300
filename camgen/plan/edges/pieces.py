"""Pieces of the lines that the arm cannot run whole, within the limits of the job."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from camgen.model.limits import format_limit
from camgen.model.part import Line, Note
from camgen.model.text import counted, short
from camgen.motion.coverage import SHORTEST_MM, Coverage
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import EdgeMotion, FoldedEdge, UnreachableEdge
from camgen.plan import MAY_END, Watch, ignore_stages
from camgen.plan.edges.poses import measure_line

#: Lines with their pose paths, or with the reasons why they have none.
LinePaths = Sequence[tuple[Line, PosePath | UnreachableEdge]]


class PieceSearch(Struct):
    """The search of pieces for the lines of one task.

    noun: "edge" or "curve".
    watch: callback that gets the progress. Where it shows any, Ctrl-C ends this search alone.
    allowed: `limits.stations`.
    stations: number of stations that were examined.
    beyond: ids of lines that would need more stations than there may be.
    unsought: ids of lines whose pieces were not sought, since the search was ended.
    too_fast: length along which a joint would have to be faster than it can be, mm, by line.
    """

    noun: str
    watch: Watch
    allowed: float
    stations: int = 0
    beyond: list[str] = []
    unsought: list[str] = []
    too_fast: dict[str, float] = {}

    def find(
        self,
        lines: LinePaths,
        whole: Sequence[EdgeMotion | UnreachableEdge],
        coverage: Coverage,
    ) -> dict[str, tuple[EdgeMotion, ...]]:
        """The motions along pieces of the lines that have no motion along the whole, by line.

        whole: the motion along each whole line, or the reason why it has no motion.
        """
        pieces: dict[str, tuple[EdgeMotion, ...]] = {}
        for (line, path), result in zip(lines, whole, strict=True):
            if isinstance(result, EdgeMotion) or not isinstance(path, PosePath | FoldedEdge):
                continue
            if self.unsought:
                self.unsought.append(line.id)
            elif motions := self._find(line, path, coverage):
                pieces[line.id] = motions
        return pieces

    def _find(
        self, line: Line, path: PosePath | FoldedEdge, coverage: Coverage
    ) -> tuple[EdgeMotion, ...]:
        whole_path = path.path if isinstance(path, FoldedEdge) else path
        folded = path.folded if isinstance(path, FoldedEdge) else None
        stations = coverage.count_stations(whole_path)
        if self.stations + stations > self.allowed:
            self.beyond.append(line.id)
            return ()
        self.stations += stations
        try:
            self.watch(f"reaching, pieces of {self.noun} {line.id}, Ctrl-C {MAY_END}")
            result = coverage.find_pieces(line, whole_path, measure_line(line, whole_path), folded)
        except KeyboardInterrupt:
            if self.watch is ignore_stages:
                raise
            self.unsought.append(line.id)
            return ()
        if result.too_fast >= SHORTEST_MM:
            self.too_fast[line.id] = result.too_fast
        return result.motions

    def explain(self, edge: UnreachableEdge) -> UnreachableEdge:
        """The edge with the length along which its joints are too slow in its reason."""
        length = self.too_fast.get(edge.id)
        if length is None:
            return edge
        what = f"the joints are too slow for process.feed along {short(length, 1)} mm of it"
        return replace(edge, text=f"{edge.text}; {what}")

    def notes(self) -> list[Note]:
        """Notes on the lines whose pieces were not sought."""
        reasons = [
            (
                self.beyond,
                f"they need more than {format_limit(self.allowed)} stations: limits.stations",
            ),
            (self.unsought, "the search was ended; the same job finds more if it is not"),
        ]
        return [
            Note(
                "assumed",
                f"pieces of {counted(len(ids), self.noun)} are not sought",
                why,
                tuple(ids),
            )
            for ids, why in reasons
            if ids
        ]
