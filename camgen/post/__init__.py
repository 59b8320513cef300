"""The contract of a post-processor.

A post prints a `Program` for one controller. `Post` has three groups of members, in this order:
members that a post must override, may override, and must not override.
The base class decides the order of calls, replaces arcs that a controller lacks, makes comments
harmless and joins the lines to files. Nothing is dropped and nothing is clamped: an instruction is
printed, replaced by a named pass, or refused with its index and a reason.

Each post has a language (`camgen.lang.programs.Language`): it runs the text of a program, and is
written from the manual of the controller and never from the post. Both are found by the same name
through the entry points `camgen.posts` and `camgen.languages`, or in one Python file (`plugins`).

    values       the values that posts return
    replacement  how `prepare` replaces arcs
    printed      how `render` prints a program by column
    contract     how camgen checks the members and the results of a plug-in

`docs/writing-a-post.md` writes a post step by step.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from camgen.model.cell import Cell, Dynamics
from camgen.model.errors import Refused
from camgen.model.part import Note
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.text import harmless
from camgen.post.printed import Forms, Printed, are_forms_current, cut_lines, join_lines
from camgen.post.replacement import replace_refused
from camgen.post.values import OutputFile, Tolerance, end_of, pose_of

__all__ = ["Forms", "OutputFile", "Post", "Tolerance", "end_of", "pose_of"]


@dataclass
class Post(ABC):
    """Base of all posts. A subclass is a dataclass whose public fields are the options of `[post]`.

    A post object prints one program. It may keep state in private fields. Lines are texts without
    a line end. Poses are work_from_tcp; units are mm, mm/s, rad, s and N.

    Must override: name, suffix, about, begin, end, movej, movel, output, wait, comment.
    May override: all other members but render, line, note and file_name.
    """

    # -- must override -----------------------------------------------------------------------------

    #: The name for `--post`: letters, digits and _.
    name: ClassVar[str]
    #: The ending of the file name, with its point.
    suffix: ClassVar[str]
    #: One line for `camgen posts`.
    about: ClassVar[str]

    @abstractmethod
    def begin(self, program: Program) -> Sequence[str]:
        """The lines before the first instruction: header, declarations, frames."""

    @abstractmethod
    def end(self, program: Program) -> Sequence[str]:
        """The lines after the last instruction."""

    @abstractmethod
    def movej(self, motion: MoveJ) -> Sequence[str]:
        """The lines of a joint-interpolated motion, to joint values or to a pose."""

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
        """`text` as a comment line. It is already harmless (`note`)."""

    # -- may override ------------------------------------------------------------------------------

    #: The line end of the file: LF, CR LF or CR.
    newline: ClassVar[str] = "\n"
    #: The endings of further files that a program may have.
    data_suffixes: ClassVar[tuple[str, ...]] = ()
    #: Whether a program may change the tool. If not, camgen writes a program for each tool.
    changes_tools: ClassVar[bool] = False
    #: Names of the passes that replace an arc that `why_not` refuses (`passes.PASSES`). They are
    #: tried in this order.
    passes: ClassVar[tuple[str, ...]] = ("chords",)
    #: The properties of motions that the text carries, as words of `verify.COMPARED`. Other
    #: properties are not compared.
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

    def movec(self, motion: MoveC) -> Sequence[str]:  # noqa: ARG002 (for overrides)
        """The lines of an arc. A post without this method refuses arcs and names `chords`."""
        raise Refused(
            self.name, -1, "the post prints no arcs", "let it refuse MoveC and name the pass chords"
        )

    def change_tool(self, item: ToolChange) -> Sequence[str]:  # noqa: ARG002 (for overrides)
        """The lines of a tool change. A post without this method leaves `changes_tools` false."""
        raise Refused(self.name, -1, *_NO_TOOL_CHANGE)

    def stop(self, item: Stop) -> Sequence[str]:  # noqa: ARG002 (for overrides)
        """The lines that stop until the operator continues. `prepare` refuses a stop without it."""
        raise Refused(self.name, -1, *_NO_STOP)

    def print_force(self, item: Force) -> Sequence[str]:  # noqa: ARG002 (for overrides)
        """The lines that turn force control on or off. A post without this method refuses Force."""
        raise Refused(self.name, -1, "the post prints no force control", "set process.force = 0")

    def why_not(
        self,
        item: Instruction,  # noqa: ARG002 (for overrides)
        before: Motion | None,  # noqa: ARG002 (for overrides)
        after: Motion | None,  # noqa: ARG002 (for overrides)
    ) -> str:
        """The reason why the controller cannot do `item`, with the remedy; empty if it can.

        before, after: the motions before and after `item`, None without one. `end_of(before)` is
            the pose in which `item` starts, None if it is not known. An arc that is replaced is
            still the neighbour of the motions beside it.
        """
        return ""

    def accepts(self, columns: Columns) -> Mask:
        """(N,): the instructions for which `why_not` is surely empty, so that it is not called.

        An arc may only be accepted if its three points are distinct and not on one line.
        """
        return columns.are(Comment)

    def refuses(self, columns: Columns) -> Mask:
        """(M,): the motions that are arcs and that `why_not` surely refuses.

        If the first of `passes` is halves, they are replaced by column.
        """
        return np.zeros(len(columns.at), np.bool_)

    def prepare(self, program: Program, chord: float) -> Program:
        """The program in instructions that this controller has. An override calls the base's.

        chord: mm that a replacement may deviate from its arc.

        Raises Refused with index and reason of the first instruction that the controller lacks.
        """
        if not self.changes_tools:
            self._refuse_kind(program, ToolChange, _NO_TOOL_CHANGE)
        if type(self).stop is Post.stop:
            self._refuse_kind(program, Stop, _NO_STOP)
        return replace_refused(self, program, chord)

    def forms(self, program: Program) -> Forms | None:  # noqa: ARG002 (for overrides)
        """How motions are printed by column, with the same lines as movej, movel and movec.

        The three methods print all other motions; None: all motions. A class that
        overrides one of them overrides `forms` too, or its inherited `forms` is not used.
        """
        return None

    def split(
        self,
        program: Program,  # noqa: ARG002 (for overrides)
        printed: Iterable[Sequence[str]],
    ) -> Sequence[Sequence[str]]:
        """The body in parts of at most `max_lines` lines; 0: in one part.

        printed: the lines of each instruction, in order.
        """
        if isinstance(printed, Printed):
            return printed.parts(self.max_lines)
        return cut_lines(printed, self.max_lines)

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """The files of the printed body. Raises Refused for several parts.

        parts: the result of `split`.
        """
        if len(parts) > 1:
            raise Refused(
                self.name,
                -1,
                f"the program is longer than {self.max_lines} lines",
                "raise post.max_lines",
            )
        text = join_lines(self.begin(program), parts[0], self.end(program))
        return (OutputFile(self.file_name(program), text),)

    @classmethod
    def cell(cls) -> Cell:
        """Frames and home for jobs without `[cell]`. Raises Refused if the post has no cell."""
        raise Refused(cls.name, -1, "the post has no built-in cell", "give it a method cell")

    def tolerance(self) -> Tolerance:
        """The largest error by which text and program may differ."""
        return Tolerance(0.5 * 10**-self.decimals, 1e-5, math.radians(5e-4), 0.01, 0.01, 0.001)

    def name_tool(
        self,
        number: int,  # noqa: ARG002 (for overrides)
        name: str,  # noqa: ARG002 (for overrides)
    ) -> Mapping[str, object]:
        """Options of `[post]` for a program that is written for one tool of `[[tools]]`.

        number, name: number and name of the tool; 0 and empty where the job states none.

        Raises JobError for a number or a name that the controller cannot have.
        """
        return {}

    def held_tool(self) -> str:
        """The tool of the controller that the program selects, in words: "tool 2".

        Empty if the program itself states the frame of its tool.
        """
        return ""

    def dynamics(self) -> Dynamics:
        """The machine that the time of a program assumes: an average machine by default."""
        return Dynamics()

    def warn(self, program: Program) -> tuple[Note, ...]:  # noqa: ARG002 (for overrides)
        """Notes on the printed program for the summary."""
        return ()

    def list_verified(self) -> frozenset[str]:
        """`verified_fields` for these options; with "work" and "tool" if the text states them."""
        return self.verified_fields

    def list_changed(self) -> frozenset[str]:
        """The changes that `prepare` makes because of an option: words of `preparation.CHANGES`.

        Any other change, except the replacement of a motion, is a fault of the post.
        """
        return frozenset()

    # -- do not override ---------------------------------------------------------------------------

    def render(self, program: Program) -> tuple[OutputFile, ...]:
        """The files of a prepared program."""
        printers = self._printers()
        printed = Printed(
            program.columns,
            lambda items: (printers[type(item)](item) for item in items),
            lambda: self.forms(program) if are_forms_current(type(self)) else None,
        )
        return self.assemble(program, self.split(program, printed))

    def line(self, item: Instruction) -> Sequence[str]:
        """The lines of one instruction."""
        return self._printers()[type(item)](item)

    def note(self, text: str) -> str:
        """Any text as a comment line that can neither end nor start a statement."""
        return self.comment(harmless(text))

    def file_name(self, program: Program) -> str:
        """The name of the (main) file."""
        return program.name + self.suffix

    def _refuse_kind(self, program: Program, kind: type, reason: tuple[str, str]) -> None:
        for index in np.flatnonzero(program.columns.are(kind))[:1].tolist():
            raise Refused(self.name, index, *reason)

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


#: Reason and remedy of a refusal.
_NO_TOOL_CHANGE = ("the post changes no tool", "write one program per tool")
_NO_STOP = ("the post prints no stop for the operator", "leave the stop out")
