"""The contract of a post-processor and of its read-back, and how both are found.

A post prints a ``Program`` for one controller. It overrides a handful of methods, one per instruction, each returning
the lines of that instruction; the base class does dispatch, legality, comments, signal names and splitting. What a
controller lacks is turned into what it has by a named pass (``passes``), or refused with its index and the reason.
Nothing is dropped, nothing clamped.

A read-back is the other half: a function from text to instructions, written from the manual and never from the post.
Both are found through entry points (``camgen.posts``, ``camgen.readbacks``) or as a path to a Python file.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, ClassVar

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import is_arc
from camgen.geometry.ragged import begins, stretches
from camgen.model.cell import Cell, Dynamics
from camgen.model.errors import Refused
from camgen.model.part import Note
from camgen.model.pose import Pose, Vec3
from camgen.model.program import (
    Body,
    Columns,
    Comment,
    Force,
    Indices,
    Instruction,
    Joints,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Packing,
    Program,
    Stop,
    ToolChange,
    Wait,
    join,
    pack,
    put_at,
)
from camgen.model.text import harmless
from camgen.post.passes import PASSES, halve_each
from camgen.post.printed import Forms, Printed, join_lines

#: So many instructions are looked at as objects at a time.
_SOME = 8192


class OutputFile(Struct, frozen=True):
    """One file of a program: its name without folder, its text with LF line ends (written with the post's own)."""

    name: str
    text: str


class Tolerance(Struct, frozen=True):
    """How exactly the text carries a program: half the last printed digit, with the rounding of angles on top.

    mm: per coordinate. angle: rad of an orientation. joint: rad (or mm) per joint. speed: mm/s. force: N. seconds: s.
    turn: rad/s of the tool on the spot. share: of the joints' greatest speeds.
    """

    mm: float
    angle: float
    joint: float
    speed: float
    force: float
    seconds: float
    turn: float = 1e-5
    share: float = 0.0


class Fault(Struct, frozen=True):
    """Something in a program text that cannot be right, or that the reader does not know. line: 1-based."""

    line: int
    what: str


class Remark(Fault, frozen=True):
    """What a controller takes although the text leaves it open: harmless in a foreign program, a fault in our own."""


class Reading(Struct, frozen=True, eq=False):
    """What a program text says.

    body: its instructions (comments left out), poses in the work frame. lines: for each, its 1-based line in the file
    ``files[k]`` it came from, counted through all files in order. work and tool: the frames that the text defines,
    None where it relies on the controller's. faults: in order of line.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    faults: tuple[Fault, ...]
    work: Pose | None = None
    tool: Pose | None = None


class _Wrong(Struct, frozen=True, eq=False):
    """An arc that the controller cannot do: its place in the body, and the pose where it starts."""

    index: int
    start: Pose
    arc: MoveC


#: A read-back: the files by name in the order written, the post's options as given in ``[post]`` -> what they say.
Readback = Callable[[Mapping[str, str], Mapping[str, object]], Reading]


@dataclass
class Post(ABC):
    """Base of all posts. Subclasses are dataclasses whose public fields are the options of ``[post]``.

    A post object renders one program: options come in through the constructor, state may live in private fields.

    *Must override*: begin, end, movej, movel, output, wait, comment. *May*: movec, print_force, why_not, accepts,
    refuses, forms, split, assemble, cell, tolerance, dynamics, warn, list_verified,
    list_changed; prepare only around a call of the base's.
    *Don't*: render, line, note.
    """

    #: What ``--post`` says, the file name's ending, the line end, and one line for ``camgen posts``.
    name: ClassVar[str]
    suffix: ClassVar[str]
    about: ClassVar[str]
    newline: ClassVar[str] = "\n"
    #: The endings of further files that a program may have.
    data_suffixes: ClassVar[tuple[str, ...]] = ()
    #: Whether a program may change the tool; else camgen writes a program a tool.
    changes_tools: ClassVar[bool] = False
    #: Names of the passes that may replace what ``why_not`` turns down, in the order in which they are tried.
    passes: ClassVar[tuple[str, ...]] = ("chords",)
    #: What the text carries of each motion; the rest is not compared. "speed" of L and C, "joint-speed" of J, which a
    #: text with "joint-share" gives by that where it is known; "blend": its radius; "stop": only whether the motion
    #: stops at its target; "turn": the speed of a turn on the spot; "force-direction": not only the newtons;
    #: "via-orientation": that at the via point of an arc; "confdata", "figure", "switches": so much of ``ir.Posture``.
    verified_fields: ClassVar[frozenset[str]] = frozenset(
        {"orientation", "speed", "joint-speed", "blend", "stop", "force-direction"}
    )

    program: str = field(
        default="", kw_only=True, metadata={"help": "program name; the input's name when empty"}
    )
    decimals: int = field(
        default=3, kw_only=True, metadata={"help": "digits after the point of a coordinate in mm"}
    )
    max_lines: int = field(
        default=0, kw_only=True, metadata={"help": "lines per file before it is split; 0: never"}
    )

    # -- must override -------------------------------------------------------------------------------------------

    @abstractmethod
    def begin(self, program: Program) -> Sequence[str]:
        """The lines before the first instruction: header, declarations, frames."""

    @abstractmethod
    def end(self, program: Program) -> Sequence[str]:
        """The lines after the last instruction."""

    @abstractmethod
    def movej(self, motion: MoveJ) -> Sequence[str]:
        """The lines of a joint-interpolated motion."""

    @abstractmethod
    def movel(self, motion: MoveL) -> Sequence[str]:
        """The lines of a straight motion."""

    @abstractmethod
    def output(self, item: Output) -> Sequence[str]:
        """The lines that set a signal."""

    @abstractmethod
    def wait(self, item: Wait) -> Sequence[str]:
        """The lines that wait."""

    @abstractmethod
    def comment(self, text: str) -> str:
        """``text``, already harmless, as a comment line."""

    # -- may override --------------------------------------------------------------------------------------------

    def movec(self, motion: MoveC) -> Sequence[str]:  # noqa: ARG002 (for those who override)
        """The lines of an arc. A post that does not override this must refuse MoveC and name the pass ``chords``."""
        raise Refused(
            self.name, -1, "the post prints no arcs", "let it refuse MoveC and name the pass chords"
        )

    def change_tool(self, item: ToolChange) -> Sequence[str]:  # noqa: ARG002 (for those who override)
        """The lines of a tool change. A post that does not override this leaves ``changes_tools`` false."""
        raise Refused(self.name, -1, "the post changes no tool", "write a program a tool")

    def stop(self, item: Stop) -> Sequence[str]:  # noqa: ARG002 (for those who override)
        """The lines that stop until the operator goes on. A post without them must refuse it."""
        raise Refused(
            self.name, -1, "the post prints no stop for the operator", "leave the stop out"
        )

    def print_force(self, item: Force) -> Sequence[str]:  # noqa: ARG002 (for those who override)
        """The lines that turn force control on or off. A post without force must refuse it."""
        raise Refused(self.name, -1, "the post prints no force control", "set process.force = 0")

    def accepts(self, columns: Columns) -> Mask:
        """(N,): the instructions that ``why_not`` accepts for sure, found by column, which spares it a look at each.

        An arc is only accepted with three points that are apart and not on one line.
        """
        return columns.are(Comment)

    def refuses(self, columns: Columns) -> Mask:
        """(M,): the arcs among the motions that ``why_not`` turns down for sure, found by column, so that they are
        replaced by column too, where the first of the ``passes`` is halves.
        """
        return np.zeros(len(columns.at), np.bool_)

    def why_not(self, item: Instruction, start: Pose | None) -> str:  # noqa: ARG002 (for those who override)
        """Why the controller cannot do ``item`` from the pose ``start``; empty when it can. Ends with the remedy."""
        return ""

    def forms(self, program: Program) -> Forms | None:  # noqa: ARG002 (for those who override)
        """How motions are printed by column, word for word as movej, movel and movec print them; these are called for
        all others. None: for all. A class that overrides one of those three overrides this too, or it does not count.
        """
        return None

    def split(self, program: Program, printed: Iterable[Sequence[str]]) -> Sequence[Sequence[str]]:  # noqa: ARG002
        """The body in parts of at most ``max_lines`` lines. printed: the lines of each instruction, in order."""
        if isinstance(printed, Printed):
            return printed.parts(self.max_lines)
        parts: list[list[str]] = [[]]
        for lines in printed:
            if self.max_lines and len(parts[-1]) + len(lines) > self.max_lines and parts[-1]:
                parts.append([])
            parts[-1] += lines
        return parts

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """Files from the printed body, one part unless it was longer than ``max_lines``."""
        if len(parts) > 1:
            raise Refused(
                self.name,
                -1,
                f"the program is longer than {self.max_lines} lines",
                "raise post.max_lines",
            )
        return (
            OutputFile(
                self.file_name(program),
                join_lines(self.begin(program), parts[0], self.end(program)),
            ),
        )

    @classmethod
    def cell(cls) -> Cell:
        """The built-in cell."""
        raise Refused(cls.name, -1, "the post has no built-in cell", "give it a method cell")

    def tolerance(self) -> Tolerance:
        """How exactly the read-back must agree."""
        return Tolerance(0.5 * 10**-self.decimals, 1e-5, math.radians(5e-4), 0.01, 0.01, 0.001)

    def dynamics(self) -> Dynamics:
        """What the time of a program is worked out with: an assumption, an average machine of its kind."""
        return Dynamics()

    def warn(self, program: Program) -> tuple[Note, ...]:  # noqa: ARG002 (for those who override)
        """What the user should know of the posted program beside its text."""
        return ()

    def list_verified(self) -> frozenset[str]:
        """What the text carries with these options: ``verified_fields``, and "work" and "tool" if it states these
        frames.
        """
        return self.verified_fields

    def list_changed(self) -> frozenset[str]:
        """The changes that ``prepare`` makes because of an option: words of ``preparation.CHANGES``.

        Any other change than a replacement of motions is a fault of the post.
        """
        return frozenset()

    # -- don't override ------------------------------------------------------------------------------------------

    def file_name(self, program: Program) -> str:
        """The name of the (main) file."""
        return program.name + self.suffix

    def prepare(self, program: Program, chord: float) -> Program:
        """The program in instructions this controller has. chord: mm that a replacement may deviate.

        Raises Refused with the index and reason of the first instruction that it lacks.
        """
        body, columns = program.body, program.columns
        changes = np.flatnonzero(columns.are(ToolChange))
        if len(changes) and not self.changes_tools:
            raise Refused(
                self.name, int(changes[0]), "the post changes no tool", "write a program a tool"
            )
        stops = np.flatnonzero(columns.are(Stop))
        if len(stops) and type(self).stop is Post.stop:
            raise Refused(
                self.name,
                int(stops[0]),
                "the post prints no stop for the operator",
                "leave the stop out",
            )
        accepted = self.accepts(columns)
        by_column, halved = self._replace_by_column(columns, accepted)
        accepted[by_column] = True
        doubtful = np.flatnonzero(~accepted)
        places: list[int] = []
        sizes: list[int] = []
        new = Packing()
        # Some at a time: as objects they take more than the whole program by column.
        for low in range(0, len(doubtful), _SOME):
            wrong, refused = self._find_wrong(columns, doubtful[low : low + _SOME])
            for one, pieces in zip(wrong, self._replace_all(wrong, chord), strict=True):
                places.append(one.index)
                sizes.append(len(pieces))
                new.extend(pieces)
            if refused is not None:
                raise refused
        if not places and not len(by_column):
            return program
        counts = np.append(np.full(len(by_column), 2), np.array(sizes, np.intp))
        where = np.append(by_column, np.array(places, np.intp))
        order = np.argsort(where)
        pieces_in_order = join(halved, new.body()).take(
            stretches(begins(counts)[order], counts[order])
        )
        return program.with_body(put_at(pack(body), where[order], counts[order], pieces_in_order))

    def _replace_by_column(self, columns: Columns, accepted: Mask) -> tuple[Indices, Body]:
        """The arcs that are replaced by two each, worked out by column, and these two, all accepted for sure."""
        none = np.zeros(0, np.intp)
        if self.passes[:1] != ("halves",):
            return none, pack(())
        arcs = np.flatnonzero(self.refuses(columns) & ~accepted[columns.at])
        arcs, tried = halve_each(columns, arcs)
        fine = self.accepts(Columns(tried)).reshape(-1, 3)[:, 1:].all(axis=1)
        rows = 3 * np.flatnonzero(fine)[:, None] + (1, 2)
        return columns.at[arcs[fine]], tried.take(rows.ravel())

    def _find_wrong(
        self, columns: Columns, doubtful: Indices
    ) -> tuple[list[_Wrong], Refused | None]:
        """The arcs at ``doubtful`` that the controller cannot do, up to the first instruction without a replacement."""
        wrong: list[_Wrong] = []
        starts = columns.poses(columns.before(doubtful))
        for index, item, start in zip(
            doubtful.tolist(), columns.pick(doubtful), starts, strict=True
        ):
            if isinstance(item, MoveC) and start is not None and not is_arc(*_points(start, item)):
                what = "the three points of the arc are on one line"
                remedy = "give the arc a via point beside its chord, or plan a line"
                return wrong, Refused(self.name, index, what, remedy)
            reason = self.why_not(item, start)
            if reason:
                if not isinstance(item, MoveC) or start is None or not self.passes:
                    return wrong, Refused(self.name, index, reason)
                wrong.append(_Wrong(index, start, item))
        return wrong, None

    def _replace_all(self, wrong: Sequence[_Wrong], chord: float) -> list[list[MoveL | MoveC]]:
        """What stands for each of the arcs. Refused for the first one without a replacement."""
        if not wrong:
            return []
        made = [PASSES[self.passes[0]](one.start, one.arc, chord) for one in wrong]
        # What is accepted for sure is found at once, behind a motion to where each arc starts.
        bodies = [
            [MoveJ(one.start, one.arc.speed), *pieces]
            for one, pieces in zip(wrong, made, strict=True)
        ]
        accepted = self.accepts(Columns(list(chain.from_iterable(bodies))))
        counts = np.fromiter(map(len, made), np.intp, len(made))
        ends, sums = np.cumsum(counts + 1), np.append(0, np.cumsum(accepted))
        sound = sums[ends] - sums[ends - counts] == counts
        return [
            pieces if fine else self._replace(one, chord)
            for one, pieces, fine in zip(wrong, made, sound.tolist(), strict=True)
        ]

    def _replace(self, wrong: _Wrong, chord: float) -> list[MoveL | MoveC]:
        """The arc as instructions that are accepted, by the first pass that achieves it; Refused where none does."""
        reason = ""
        for name in self.passes:
            pieces = PASSES[name](wrong.start, wrong.arc, chord)
            here: Pose | None = wrong.start
            for piece in pieces:
                reason = self.why_not(piece, here)
                if reason:
                    break
                here = piece.target
            else:
                return pieces
        raise Refused(self.name, wrong.index, reason)

    def render(self, program: Program) -> tuple[OutputFile, ...]:
        """The program as files. Every instruction must be one that the controller has (``prepare``)."""
        of = self._printers()
        find = self.forms if _prints_by_column(type(self)) else _no_forms
        printed = Printed(
            program.columns,
            lambda items: (of[type(one)](one) for one in items),
            lambda: find(program),
        )
        return self.assemble(program, self.split(program, printed))

    def line(self, item: Instruction) -> Sequence[str]:
        """The lines of one instruction."""
        return self._printers()[type(item)](item)

    def _printers(self) -> dict[type, Callable[[Any], Sequence[str]]]:
        return {
            MoveL: self.movel,
            MoveC: self.movec,
            MoveJ: self.movej,
            Output: self.output,
            Wait: self.wait,
            Force: self.print_force,
            ToolChange: self.change_tool,
            Stop: self.stop,
            Comment: lambda item: (self.note(item.text),),
        }

    def note(self, text: str) -> str:
        """Any text as a comment line that can neither end nor start anything."""
        return self.comment(harmless(text))


#: What prints motions one by one.
_MOTIONS = ("movej", "movel", "movec")


def _prints_by_column(post: type[Post]) -> bool:
    """Whether ``forms`` is not older than what prints motions: a class may print them otherwise than its parent."""
    order = post.__mro__
    defined = {
        name: next(k for k, one in enumerate(order) if name in vars(one))
        for name in (*_MOTIONS, "forms")
    }
    return all(defined["forms"] <= defined[name] for name in _MOTIONS)


def _no_forms(_program: Program) -> None:
    return None


def pose_of(motion: Motion) -> Pose:
    """The Cartesian target of a motion that has one."""
    if isinstance(motion.target, Joints):
        raise ValueError("a motion to joints has no pose")
    return motion.target


def _points(start: Pose, arc: MoveC) -> tuple[Vec3, Vec3, Vec3]:
    return start.origin, arc.via.origin, arc.target.origin
