"""Read-backs with a fast path: it reads the same as the general parser from any text."""

import random
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import NamedTuple
from unittest.mock import patch

from camgen.lang.columns import Run, Template
from camgen.lang.programs import Executed
from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Wait,
)
from tests.support.damage import Damage
from tests.support.samples import Options


class FastPath(NamedTuple):
    """The fast path of a read-back.

    read: the read-back.
    files: names of the first and the second file of a program.
    functions: names of functions that only the fast path calls.
    closed: names of attributes, and the values that close the fast path.
    template: the usual spelling of a line.
    lines: pattern of one line, as the general parser takes it.
    line_end: pattern of the end of a line.
    by_hand: a text of each kind of statement, for which the fast path is open.
    signed_zeros: whether the sign of a zero is the same on both paths.
    texts: texts with their options.
    numbers: text with places for twelve numbers, and the first number of each origin.
    damage: ways to damage a text.
    limit: name of a bound of the run, and values; None leaves it as it is.
    """

    read: Callable[[Mapping[str, str], Options], Executed]
    files: tuple[str, str]
    functions: Sequence[str]
    closed: Sequence[tuple[str, object]]
    template: Template
    lines: re.Pattern[str]
    line_end: str
    by_hand: str
    signed_zeros: bool
    texts: Sequence[tuple[str, Options]]
    numbers: tuple[str, Sequence[int]]
    damage: Damage
    limit: tuple[str, Sequence[int | None]]

    def read_generally(self, files: Mapping[str, str], options: Options) -> Executed:
        """The reading of the general parser alone."""
        with patched(self.closed):
            return self.read(files, options)

    def check_files(self, files: Mapping[str, str], options: Options) -> Executed:
        """The reading of files. Raises AssertionError if the paths read them differently."""
        reading = self.read(files, options)
        general = self.read_generally(files, options)
        signed = self.signed_zeros
        assert list_values(reading, signed) == list_values(general, signed), files
        return reading

    def check(self, text: str, options: Options) -> Executed:
        """The reading of a text. Raises AssertionError if the paths read it differently."""
        return self.check_files({self.files[0]: text}, options)

    def count_fast(self, text: str) -> int:
        """Number of lines that the fast path takes."""
        return sum(len(piece) for piece in self.template.cut(text) if isinstance(piece, Run))

    def cut(self, text: str, chance: random.Random) -> dict[str, str]:
        """The text as one file, or cut into two at any place."""
        first, second = self.files
        place = chance.randrange(len(text) + 1)
        if chance.random() < 0.7:
            return {first: text}
        return {first: text[:place], second: chance.choice(self.damage.headers) + text[place:]}


def cut_nothing(_: Template, text: str) -> Iterator[Run | str]:
    """In place of `Template.cut`: no line is in the usual spelling."""
    return iter([text] if text else [])


@contextmanager
def patched(attributes: Sequence[tuple[str, object]]) -> Iterator[None]:
    """Each attribute has its value within the context."""
    with ExitStack() as stack:
        for name, value in attributes:
            stack.enter_context(patch(name, value))
        yield


def list_values(reading: Executed, signed_zeros: bool) -> list[object]:
    """A reading as plain values, which are equal if each bit is."""
    body: list[object] = []
    for item in reading.body:
        values = [getattr(item, name) for name in item.__struct_fields__]
        body.append((type(item).__name__, *(_plain(value, signed_zeros) for value in values)))
    frames = [_plain(frame, signed_zeros) for frame in (reading.work, reading.tool)]
    return [body, reading.lines, reading.findings, *frames]


def _plain(value: object, signed_zeros: bool) -> object:
    """`value` as a value to compare; without the sign of a zero unless `signed_zeros`."""
    # The sum of a negative zero and zero is zero.
    addend = -0.0 if signed_zeros else 0.0
    if isinstance(value, Pose):
        origin = tuple(number + addend for number in value.origin)
        return repr(origin), (value.rotation + addend).tobytes()
    if isinstance(value, Joints):
        return repr([number + addend for number in value.values])
    return repr(value)


def list_paths(
    home: Instruction, count: int, lines: int, force: float = 0.0, turning: bool = False
) -> list[Instruction]:
    """Body of a program with `count` paths, each of `lines` blended lines and an arc.

    force: force along each path, N.
    turning: whether the tool turns about its axis at the start of a path and along its lines.
    """
    press = (0.0, -1.0, 0.0) if force else (0.0, 0.0, 0.0)
    body = [home, Comment("a remark"), MoveJ(Pose(TOOL_DOWN, (0, 0, 20)), 100.0)]
    for path in range(count):
        x = 8.0 * path
        rotation = TOOL_DOWN
        start = Pose(rotation, (x, 0.125, 0.0))
        body += [MoveJ(start, 200.0), Output("process", 1.0)]
        if turning:
            turned = frozen(rotation_about(2, 0.5) @ rotation)
            body.append(MoveL(Pose(turned, start.origin), 20.0, turn=1.0))
            body.append(MoveL(start, 20.0, turn=0.5))
        if force:
            body.append(Force(force, press))
        for line in range(lines):
            if turning:
                rotation = frozen(rotation_about(2, 0.1 * (line + 1)) @ TOOL_DOWN)
            corner = Pose(rotation, (x - 0.5 * (line + 1), 0.125 * line, 0.0))
            blend = 1.0 if line + 1 < lines else 0.0
            body.append(MoveL(corner, 20.0 + path, blend, force, press))
        via, end = Pose(rotation, (x + 2, 2.125, 0.0)), Pose(rotation, (x + 4, 0.125, 0.0))
        body.append(MoveC(via, end, 12.5, 0.0, force, press))
        body.append(Force(0.0) if force else Wait(0.25))
        body.append(Output("process", 0.0))
    return [*body, MoveL(Pose(TOOL_DOWN, (0, 0, 20)), 50.0), home]
