"""The conformance kit: what every post and its read-back must show, for those who write one (docs/writing-a-post.md).

    @pytest.mark.parametrize("case", cases(), ids=str)
    def test_conformance(case):
        check_case(MyPost, my_read, case, lacks={"force", "tilt"})

Each case is a small program. It is prepared, rendered twice, looked over as text, read back and compared. A post may
refuse an instruction only if the test declares that its controller lacks the feature, and then by index and reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping

import numpy as np

from camgen.check import compare
from camgen.errors import CamgenError, Refused
from camgen.ir import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.ir_text import dump
from camgen.plugins import make_post
from camgen.pose import TOOL_DOWN, Pose
from camgen.post import OutputFile, Post, Readback
from camgen.testing_cases import Case, cases

__all__ = ["FEATURES", "WHOLE", "Case", "cases", "check_case", "conformance"]

#: What a replacement of an arc may deviate in these cases, mm.
CHORD = 0.01


def _tilted(pose: Pose) -> bool:
    return math.hypot(*pose.rotation[:2, 2]) > 1e-12 or pose.rotation[2, 2] > 0


def _poses(item: Instruction) -> list[Pose]:
    if not isinstance(item, (MoveJ, MoveL, MoveC)) or isinstance(item.target, Joints):
        return []
    return [item.target, item.via] if isinstance(item, MoveC) else [item.target]


#: What a controller may lack, each with the instructions that use it. Anything else may not be refused.
FEATURES: Mapping[str, Callable[[Instruction], bool]] = {
    "arcs": lambda item: isinstance(item, MoveC),
    "force": lambda item: isinstance(item, Force) or (isinstance(item, (MoveL, MoveC)) and item.force > 0),
    "joints": lambda item: isinstance(item, MoveJ) and isinstance(item.target, Joints),
    "turn": lambda item: any(not np.array_equal(pose.rotation, TOOL_DOWN) for pose in _poses(item)),
    "tilt": lambda item: any(_tilted(pose) for pose in _poses(item)),
    "process": lambda item: isinstance(item, Output) and item.signal == "process",
    "spindle": lambda item: isinstance(item, Output) and item.signal == "spindle",
    "signals": lambda item: isinstance(item, Output) and item.signal not in ("process", "spindle"),
    "short waits": lambda item: isinstance(item, Wait) and item.seconds < 0.002,
    "fine blends": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and 0 < item.blend < 1,
    "slow": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and item.speed < 1,
    "fast": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and item.speed > 200,
    "large": lambda item: any(max(map(abs, pose.origin)) > 2e3 for pose in _poses(item)),
}
#: What a controller may lack as a whole, refused with index -1: names it cannot take, programs longer than one file.
WHOLE = ("names", "split")


def check_case(
    post: type[Post],
    readback: Readback,
    case: Case,
    options: Mapping[str, object] | None = None,
    lacks: Collection[str] = (),
) -> None:
    """AssertionError with all findings of one case. lacks: keys of ``FEATURES`` or ``WHOLE``."""
    found = list(_findings(post, readback, case, dict(options or {}), lacks))
    if found:
        raise AssertionError("\n".join(found))


def conformance(
    post: type[Post],
    readback: Readback,
    options: Mapping[str, object] | None = None,
    lacks: Collection[str] = (),
) -> list[str]:
    """The findings of all cases, one line each; none for a post that conforms."""
    return [line for case in cases() for line in _findings(post, readback, case, dict(options or {}), lacks)]


def _findings(
    post: type[Post], readback: Readback, case: Case, options: Mapping[str, object], lacks: Collection[str]
) -> Iterator[str]:
    unknown = set(lacks) - set(FEATURES) - set(WHOLE)
    if unknown:
        raise ValueError(f"no such feature: {sorted(unknown)}; there are {[*FEATURES, *WHOLE]}")
    options = {**options, **case.options}
    program = case.program(post.cell())
    before = dump(program)
    try:
        maker, other = make_post(post, options), make_post(post, options)
        prepared = maker.prepare(program, CHORD)
        files = maker.render(prepared)
        again = other.render(other.prepare(program, CHORD))
    except Refused as refusal:
        yield from (f"{case}: {line}" for line in _unfounded(refusal, program, lacks))
        return
    except CamgenError as error:
        yield f"{case}: {type(error).__name__}: {error}"
        return
    if dump(program) != before:
        yield f"{case}: rendering changes the program"
    if files != again:
        yield f"{case}: the same program gives two texts"
    yield from (f"{case}: {line}" for file in files for line in _illegal(file, post, case.clean))
    if len({file.name for file in files}) < len(files) or not files:
        yield f"{case}: no file, or two with one name"
        return
    try:
        reading = readback({file.name: file.text for file in files}, options)
        compare(prepared, reading, maker.tolerance(), maker.carried(), files[0].name)
    except CamgenError as error:
        yield f"{case}: {error}"


def _unfounded(refusal: Refused, program: Program, lacks: Collection[str]) -> Iterator[str]:
    """What is wrong with a refusal."""
    if not refusal.what.strip():
        yield "refused without a reason"
    if refusal.index < 0:
        if not set(WHOLE) & set(lacks):
            yield f"refused as a whole, though it lacks neither {WHOLE[0]} nor {WHOLE[1]}: {refusal}"
    elif refusal.index >= len(program.body):
        yield f"refused instruction {refusal.index}, which is not there: {refusal}"
    elif not any(FEATURES[name](program.body[refusal.index]) for name in set(lacks) & set(FEATURES)):
        kind = type(program.body[refusal.index]).__name__
        yield f"refused a {kind} that uses nothing the controller is said to lack: {refusal}"


#: Numbers that no controller takes, or that none should be given: not a number, an exponent of Python's, minus zero.
_BAD_NUMBERS = {
    "a number that is none": re.compile(r"(?i)(?:\b|(?<=[=,( ][a-z]))(?:nan|inf)\b"),
    "an exponent": re.compile(r"\d[eE][+-]\d|\d\.\d*[eE]\d"),
    "a minus zero": re.compile(r"-0+(?:\.0*)?(?![\d.])"),
}


def _illegal(file: OutputFile, post: type[Post], clean: bool) -> Iterator[str]:
    """What no text may hold."""
    if not file.name or file.name != file.name.strip() or re.search(r"[/\\\x00-\x1f]", file.name):
        yield f"{file.name!r} is no file name"
    if not file.name.endswith(post.suffix):
        yield f"{file.name} does not end with {post.suffix}"
    if not file.text.isascii():
        yield f"{file.name} is not ASCII"
    if re.search(r"[^\n\t -~]", file.text):
        yield f"{file.name} has a control character; lines end with \\n, the post's own newline is put in later"
    if not file.text.endswith("\n"):
        yield f"{file.name} does not end with a newline"
    for what, pattern in _BAD_NUMBERS.items():
        for found in list(pattern.finditer(file.text))[: int(clean)]:
            line = file.text.count("\n", 0, found.start()) + 1
            yield f"{file.name} has {what} in line {line}: {file.text.splitlines()[line - 1]}"
