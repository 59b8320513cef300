"""The conformance kit: tests that every post and its language pass (docs/writing-a-post.md).

    @pytest.mark.parametrize("case", cases(), ids=str)
    def test_conformance(case):
        check_case(MyPost, MY_LANGUAGE, case, lacks={"force", "tilt"})

Each case is a small program. It is prepared, rendered twice, examined as text, run strictly and
compared. It is also run as `camgen verify` runs a program of any author. A post may refuse an
instruction only if the test declares that its controller lacks the feature, and then by index and
reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial
from itertools import chain, pairwise, product, starmap
from typing import Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.lang.programs import Executed, Language, RunRequest, check_language
from camgen.model.cell import Cell
from camgen.model.contract import check_members
from camgen.model.errors import CamgenError, Refused, VerifyError
from camgen.model.pose import (
    IDENTITY,
    TOOL_DOWN,
    FloatArray,
    Pose,
    Vec3,
    angle_between,
    frozen,
    rotation_about,
    rotation_about_axis,
    rotation_from_fixed_xyz,
    to_vec3,
)
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    ToolChange,
    Wait,
    switch_off_first,
)
from camgen.model.text import counted
from camgen.post import OutputFile, Post, Tolerance
from camgen.post.altered import alter_numbers, is_excused
from camgen.post.contract import (
    CORRECT_POST,
    POST_CLASS,
    name_post,
    prepare_program,
)
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import Readback, fill_tables, make_post, read_back
from camgen.post.verify import compare

Body = tuple[Instruction, ...]


class Case(Struct, frozen=True):
    """A program that starts at the home position of the cell of the post.

    name: its subject.
    body: the instructions after home, with joint values for as many axes as home has. The machine
        is at home before and after each tool change; a program with tool changes starts with one.
    title: name of the program.
    header: lines of the header of the program.
    options: options of the post, added to those of the test.
    clean: whether the comments are harmless words, so that numbers in the text can be judged.
    work: the work frame; None: the one of the cell.
    altered: the numbers of the text that are changed one at a time; "body": the numbers of
        instructions.
    """

    name: str
    body: Body
    title: str = "kit"
    header: tuple[str, ...] = ("a case of the conformance kit",)
    options: Mapping[str, object] = field(default_factory=dict)
    clean: bool = True
    work: Pose | None = None
    altered: Literal["", "body", "all"] = ""

    def __str__(self) -> str:
        return self.name

    def program(self, cell: Cell) -> Program:
        """Make the program in the frames of `cell`."""
        axes = len(cell.home.values) if isinstance(cell.home, Joints) else None
        home = MoveJ(cell.home, 100.0)
        is_at_home = bool(self.body) and isinstance(self.body[0], ToolChange)
        body: list[Instruction] = [] if is_at_home else [home]
        for item in self.body:
            if isinstance(item, ToolChange):
                body += [item, home] if is_at_home else [home, item, home]
            elif isinstance(item, MoveJ) and isinstance(item.target, Joints):
                body.append(replace(item, target=Joints(item.target.values[:axes])))
            else:
                body.append(item)
            is_at_home = False
        work = self.work or cell.base_from_work
        safe = switch_off_first(tuple(body))
        return Program(self.title, work, cell.flange_from_tool, safe, self.header)


def _at(x: float, y: float, z: float = 0.0, rotation: FloatArray = TOOL_DOWN) -> Pose:
    return Pose(rotation, (x, y, z))


def _line(x: float, y: float, z: float = 0.0, speed: float = 20.0, blend: float = 0.0) -> MoveL:
    return MoveL(_at(x, y, z), speed, blend)


_ABOVE = MoveJ(_at(10.0, 10.0, 20.0), 100.0)
_PI = math.pi


def _arc(
    centre: Vec3, radius: float, begin: float, sweep: float, tilt: FloatArray = IDENTITY
) -> Body:
    """Move to the start of an arc of `sweep` rad and along it, in the xy plane tilted by `tilt`."""
    poses = []
    for angle in (begin, begin + sweep / 2, begin + sweep):
        spoke = tilt @ (radius * math.cos(angle), radius * math.sin(angle), 0.0)
        poses.append(Pose(TOOL_DOWN, to_vec3(np.asarray(centre) + spoke)))
    return (MoveL(poses[0], 20.0), MoveC(poses[1], poses[2], 15.0))


def _orient(name: str, rotations: list[FloatArray]) -> Case:
    """Lines to orientations; joint motions by 180 deg, since a line leaves the direction open."""
    body: list[Instruction] = [_ABOVE]
    for i, (before, rotation) in enumerate(pairwise([TOOL_DOWN, *rotations])):
        kind = MoveJ if angle_between(before, rotation) > math.radians(179) else MoveL
        body.append(kind(_at(10.0 + 5 * i, 10.0, 5.0, rotation), 20.0))
    return Case(name, tuple(body))


def _turn_tool(axis: int, angles: Iterable[float]) -> list[FloatArray]:
    """The orientation straight down, turned about an axis of the tool by each angle, deg."""
    return [frozen(TOOL_DOWN @ rotation_about(axis, math.radians(angle))) for angle in angles]


def _orientations() -> Iterator[Case]:
    """Tool down and rotated; all poles of angle triples and quaternions; orientations near them."""
    yield _orient("tool turned", _turn_tool(2, (30.0, 45.0, 90.0, 135.0, 180.0, -90.0, -0.001)))
    quarter = (0.0, _PI / 2, _PI, -_PI / 2)
    angles = product(quarter, (0.0, _PI / 2, -_PI / 2), quarter)
    yield _orient("axes along axes", list(starmap(rotation_from_fixed_xyz, angles)))
    poles = [TOOL_DOWN, IDENTITY, rotation_about(1, _PI / 2), rotation_about(1, -_PI / 2)]
    small = product(poles, (0, 1, 2), (1e-3, -1e-5, 1e-7, -1e-10))
    near = [frozen(pole @ rotation_about(axis, angle)) for pole, axis, angle in small]
    yield _orient("close to a pole", near)
    axes = [
        np.array(v) / np.linalg.norm(v) for v in ((1, 2, 3), (-1, 2, 0.5), (3, -1, -2), (0, 1, 1))
    ]
    yield _orient("half turns", list(starmap(rotation_about_axis, product(axes, (_PI,)))))
    yield _orient("any turns", list(starmap(rotation_about_axis, product(axes, (0.3, 1.7, -2.9)))))


def _numbers() -> Iterator[Case]:
    tiny = (1e-7, -1e-7, 4e-4, -4e-4, 5e-4, -5e-4, 1e-5, -0.0, 0.0012345)
    yield Case("small numbers", (_ABOVE, *(_line(v, -v, 1.0 + i) for i, v in enumerate(tiny))))
    yield Case(
        "numbers about a digit",
        (_ABOVE, *(_line(10.0 + 0.1 * i + 0.0005, 2.0 / 3, 1.0 / 7) for i in range(9))),
    )
    yield Case("metres", (_ABOVE, _line(1999.9995, -1999.9995, 1234.56789), _line(1.0, 1.0)))
    yield Case(
        "large numbers", (_ABOVE, _line(9999.9995, -9999.9995), _line(99999.125, -99999.125))
    )
    speeds = (0.1, 0.75, 3.0, 12.345, 20.0, 33.3333, 150.0, 250.0, 1000.0, 3000.0)
    yield Case("speeds", (_ABOVE, *(_line(10.0 * i, 0.0, 5.0, v) for i, v in enumerate(speeds))))
    yield Case("waits", (_ABOVE, *map(Wait, (0.5, 0.123, 10.0, 3600.0, 0.001, 0.0))))


def _arcs() -> Iterator[Case]:
    half, quarter = _PI, _PI / 2
    quarters = [_arc((20.0, 20.0, 0.0), 10.0, k, quarter) for k in range(4)]
    yield Case("quarter arcs", (_ABOVE, *chain.from_iterable(quarters)), altered="body")
    yield Case(
        "half circles",
        (_ABOVE, *_arc((0.0, 0.0, 0.0), 25.0, 0.3, half), *_arc((0, 0, 0), 25.0, 0.3, -half)),
    )
    first, last = _arc((0.0, 0.0, 0.0), 8.0, 0.0, -2.0), _arc((0.0, 0.0, 0.0), 8.0, -2.0, -1.0)
    yield Case("arc after arc", (_ABOVE, *first, last[1]))
    small = [_arc((5.0, 5.0, 0.0), r, 1.0, -quarter) for r in (1.0, 0.2, 0.05)]
    yield Case("small arcs", (_ABOVE, *chain.from_iterable(small)))
    flat = [_arc((0.0, r, 0.0), r, -quarter, 50.0 / r) for r in (1e3, 1e4, 1e5)]
    yield Case("flat arcs", (_ABOVE, *chain.from_iterable(flat)))
    planes = [
        rotation_about(0, _PI / 2),
        rotation_about(1, _PI / 2),
        rotation_about_axis(np.array([0.6, 0.8, 0.0]), 1),
    ]
    tilted = [_arc((0.0, 0.0, 30.0), 9.0, 0.2, 2.5, plane) for plane in planes]
    yield Case("arcs in space", (_ABOVE, *chain.from_iterable(tilted)))


def _forces() -> Iterator[Case]:
    on = (_line(10.0, 0.0), Force(12.5, (0.0, 1.0, 0.0)))
    along = tuple(
        MoveL(_at(20.0 + 10 * i, 0.0), 20.0, 0.0, n, (0.0, 1.0, 0.0))
        for i, n in enumerate((12.5, 8.25))
    )
    pressing: Body = (_ABOVE, *on, *along, Force(0.0), _line(30.0, 0.0, 20.0))
    yield Case("force", pressing, altered="body")
    s = math.sqrt(0.5)
    arc = MoveC(_at(10 * s, 10 * s), _at(0.0, 10.0), 20.0, 0.0, 12.0, (0.0, -1.0, 0.0))
    round_corner = (
        _line(10.0, 0.0),
        Force(12.0, (-1.0, 0.0, 0.0)),
        arc,
        Force(0.0),
        _line(0.0, 10.0, 20.0),
    )
    yield Case("force along an arc", (_ABOVE, *round_corner))
    yield Case(
        "force twice",
        (_ABOVE, *on, *along, Force(0.0), _line(10.0, 10.0, 20.0), *on, *along, Force(0.0)),
    )


#: Comments that try to end the comment, to start an instruction, or to reach the parser of the
#: controller in another way.
HOSTILE = (
    ") M3 S9999 (",
    "* / ; G0 Z-50",
    "\nG0 Z-50",
    "\r\nMoveL p1,v100,fine,tool0;",
    "! ~ ? \x18 \x00",
    "'Stop",
    "%",
    "#1=5",
    "ENDPROC ENDMODULE",
    "End Sub",
    ".END",
    '" & Run evil',
    "(MSG, hello)",
    "Größe ☃ \u2028 next",
    "",
    " ",
    "x" * 500,
)


def _words() -> Iterator[Case]:
    remarks = tuple(map(Comment, HOSTILE))
    moves = tuple(_line(10.0 * i, 5.0) for i in range(3))
    yield Case("hostile comments", (_ABOVE, *remarks, *moves, *remarks), clean=False)
    yield Case("hostile header", (_ABOVE, *moves), header=HOSTILE, clean=False)
    yield Case("comments alone", (Comment("one"), _ABOVE, Comment("two"), Comment("three")))
    for title in (
        "a_name_of_seventy_letters_that_no_controller_takes_as_it_stands_xxxxxxx",
        "9 holes - left",
        "End",
        "ü",
    ):
        yield Case(f"named {title[:14]}", (_ABOVE, *moves), title=title)


def cases() -> list[Case]:
    """Return all cases, in order."""
    on, stop = Output("process", 1.0), Output("process", 0.0)
    joints: list[Instruction] = []
    for sign in (1, -1, 3):
        joints.append(MoveJ(Joints(tuple(0.1 * k * sign for k in range(1, 7))), 80.0))
    blends = tuple(
        _line(10.0 + 20 * i, 20.0 * (i % 2), 0.0, 20.0, b)
        for i, b in enumerate((5.0, 1.0, 0.3, 0.0))
    )
    corners = tuple(MoveJ(_at(50.0 * i, 0.0, 20.0), 90.0, b) for i, b in enumerate((5.0, 0.0)))
    lines = tuple(
        _line(float(i), float(i % 7), 0.0, 20.0, 0.0 if i % 10 == 9 else 1.0) for i in range(200)
    )
    return [
        Case("nothing", ()),
        Case("joint moves", tuple(joints)),
        Case("moves to poses", (_ABOVE, *corners)),
        Case(
            "straight moves",
            (_ABOVE, _line(10.0, 10.0), _line(40.0, 10.0), _line(40.0, 30.125, -1.5)),
        ),
        Case("blends", (_ABOVE, *blends), altered="body"),
        Case("blending arcs", (_ABOVE, *(_blending_arcs()))),
        Case(
            "process",
            (_ABOVE, on, _line(40.0, 10.0), stop, _line(0.0, 0.0), on, Wait(0.25), stop),
            altered="body",
        ),
        Case("signals", (_ABOVE, Output("glue", 1.0), _line(40.0, 10.0), Output("glue", 0.0))),
        Case(
            "spindle",
            (
                Output("spindle", 12000.0),
                Wait(1.5),
                _ABOVE,
                _line(10.0, 10.0),
                Output("spindle", 0.0),
            ),
            altered="body",
        ),
        Case(
            "frames",
            (_ABOVE, _line(40.0, 10.0)),
            work=Pose(rotation_about(2, 0.5), (450.125, -120.5, 35.0625)),
        ),
        Case("numbers of the text", (_ABOVE, _line(40.0, 10.0)), altered="all"),
        Case("stops", (_ABOVE, on, _line(40.0, 10.0), stop, Stop(), _line(0.0, 0.0), Stop())),
        Case("optional stops", (_ABOVE, Stop(True), _line(40.0, 10.0), Stop(True))),
        Case("tool changes", _change_tools(), altered="body"),
        *_reorientations(),
        Case("many lines", (_ABOVE, *lines)),
        Case("several files", (_ABOVE, *lines, on, Wait(0.5), stop), options={"max_lines": 50}),
        *_numbers(),
        *_arcs(),
        *_orientations(),
        *_forces(),
        *_words(),
    ]


def _change_tools() -> Body:
    cut = (_ABOVE, _line(10.0, 10.0), _line(40.0, 10.0), _line(40.0, 10.0, 20.0))
    mill, drill = ToolChange(2, "mill", 6.0, 50.0), ToolChange(12, "drill", 3.5, 62.5)
    return (mill, *cut, drill, *cut)


def _reorientations() -> Iterator[Case]:
    upright, tilted = _turn_tool(2, (30.0, -45.0)), _turn_tool(0, (15.0, 40.0))
    for name, rotations in (("turns on the spot", upright), ("tilts on the spot", tilted)):
        body: list[Instruction] = [_ABOVE, _line(10.0, 10.0, 5.0)]
        for rotation, speed in zip(rotations, (0.25, 0.5), strict=True):
            body.append(MoveL(_at(10.0, 10.0, 5.0, rotation), 20.0, turn=speed))
        body.append(MoveL(_at(30.0, 10.0, 5.0, rotations[-1]), 20.0))
        yield Case(name, tuple(body), altered="body")


def _blending_arcs() -> Iterator[Instruction]:
    first, last = _arc((0.0, 0.0, 0.0), 30.0, 0.0, 1.0), _arc((0.0, 0.0, 0.0), 30.0, 1.0, 1.0)
    yield first[0]
    for item, blend in ((first[1], 1.0), (last[1], 0.0)):
        if isinstance(item, MoveC):
            yield MoveC(item.via, item.target, item.speed, blend)


#: mm: distance by which the replacement of an arc may leave it in these cases.
CHORD = 0.01


def _is_tilted(pose: Pose) -> bool:
    return math.hypot(*pose.rotation[:2, 2]) > 1e-12 or pose.rotation[2, 2] > 0


def _list_poses(item: Instruction) -> list[Pose]:
    if not isinstance(item, (MoveJ, MoveL, MoveC)) or isinstance(item.target, Joints):
        return []
    return [item.target, item.via] if isinstance(item, MoveC) else [item.target]


#: Features that a controller may lack, each with the instructions that use it. A post may refuse
#: nothing else.
FEATURES: Mapping[str, Callable[[Instruction], bool]] = {
    "arcs": lambda item: isinstance(item, MoveC),
    "force": lambda item: (
        isinstance(item, Force) or (isinstance(item, (MoveL, MoveC)) and item.force > 0)
    ),
    "joints": lambda item: isinstance(item, MoveJ) and isinstance(item.target, Joints),
    "turn": lambda item: any(
        not np.array_equal(pose.rotation, TOOL_DOWN) for pose in _list_poses(item)
    ),
    "tilt": lambda item: any(map(_is_tilted, _list_poses(item))),
    "process": lambda item: isinstance(item, Output) and item.signal == "process",
    "spindle": lambda item: isinstance(item, Output) and item.signal == "spindle",
    "signals": lambda item: isinstance(item, Output) and item.signal not in ("process", "spindle"),
    "stops": lambda item: isinstance(item, Stop),
    "optional stops": lambda item: isinstance(item, Stop) and item.optional,
    "tool changes": lambda item: isinstance(item, ToolChange),
    "reorientations": lambda item: isinstance(item, MoveL) and item.turn > 0,
    "short waits": lambda item: isinstance(item, Wait) and item.seconds < 0.002,
    "fine blends": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and 0 < item.blend < 1,
    "slow": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and item.speed < 1,
    "fast": lambda item: isinstance(item, (MoveJ, MoveL, MoveC)) and item.speed > 200,
    "large": lambda item: any(max(map(abs, pose.origin)) > 2e3 for pose in _list_poses(item)),
}
#: Features whose lack refuses a whole program, with index -1: names that the controller cannot
#: take, and programs longer than one file.
WHOLE = ("names", "split")


class _Kit(Struct, frozen=True):
    """A post and its language under test, with the statements of their author: see `check_case`."""

    post: type[Post]
    language: Language
    options: Mapping[str, object]
    lacks: Collection[str]
    meaningless: Collection[str]


def check_case(
    post: type[Post],
    language: Language,
    case: Case,
    options: Mapping[str, object] | None = None,
    lacks: Collection[str] = (),
    meaningless: Collection[str] = (),
) -> None:
    """Check one case. Raises AssertionError with all its findings.

    lacks: keys of `FEATURES` or `WHOLE` that the controller does not have.
    meaningless: patterns of text that may change without a change of the meaning, such as remarks;
        in a pattern with a group, the text of the group.
    """
    findings = _list_findings(_Kit(post, language, dict(options or {}), lacks, meaningless), case)
    if findings:
        raise AssertionError("\n".join(findings))


def conformance(
    post: type[Post],
    language: Language,
    options: Mapping[str, object] | None = None,
    lacks: Collection[str] = (),
    meaningless: Collection[str] = (),
) -> list[str]:
    """Return the findings of all cases, one line each; empty for a post that conforms."""
    kit = _Kit(post, language, dict(options or {}), lacks, meaningless)
    findings: list[str] = []
    for case in cases():
        findings += _list_findings(kit, case)
    return findings


def _list_findings(kit: _Kit, case: Case) -> list[str]:
    return [f"{case}: {finding}" for finding in _find_findings(kit, case)]


def _spell(program: Program) -> bytes:
    words = (program.name, program.header, program.base_from_work, program.flange_from_tool)
    return msgspec.json.encode([*words, *program.body, *program.paths], enc_hook=np.ndarray.tolist)


def _find_findings(kit: _Kit, case: Case) -> Iterator[str]:
    post, lacks = kit.post, kit.lacks
    unknown = set(lacks) - set(FEATURES) - set(WHOLE)
    if unknown:
        raise ValueError(f"no such feature: {sorted(unknown)}; there are {[*FEATURES, *WHOLE]}")
    options = fill_tables(post, {**kit.options, **case.options})
    program = case.program(post.cell())
    before = _spell(program)
    try:
        check_members(name_post(post), POST_CLASS, post, CORRECT_POST)
        maker, other = make_post(post, options), make_post(post, options)
        tolerance = limit_tolerance(maker.tolerance(), CHORD)
        prepared = prepare_program(maker, program, CHORD)
        files = maker.render(prepared)
        again = other.render(other.prepare(program, CHORD))
    except Refused as refusal:
        yield from _find_unfounded(refusal, program, lacks)
        return
    except CamgenError as error:
        yield f"{type(error).__name__}: {error}"
        return
    if _spell(program) != before:
        yield "rendering changes the program"
    if files != again:
        yield "the same program gives two texts"
    for file in files:
        yield from _find_illegal(file, post, case.clean)
    texts = {file.name: file.text for file in files}
    if len(texts) < len(files) or not files:
        yield "no file, or two with one name"
        return
    try:
        language = check_language(kit.language)
        check = _Check(maker, partial(read_back, language.run), options, prepared, tolerance)
        check.run(texts)
        yield from _find_unknown(language, texts, prepared)
    except CamgenError as error:
        yield str(error)
        return
    if case.altered and len(files) == 1:
        yield from _find_unseen(kit, case, check, files[0])


class _Check(NamedTuple):
    """The check of the texts of a case: the read-back with its options, and the comparison."""

    post: Post
    readback: Readback
    options: Mapping[str, object]
    prepared: Program
    tolerance: Tolerance

    def run(self, texts: Mapping[str, str]) -> Executed:
        """Run texts by file name. Raises VerifyError if they are not the prepared program."""
        executed = self.readback(texts, self.options)
        words = self.post.list_verified()
        compare(self.prepared, executed, self.tolerance, words, next(iter(texts)))
        return executed


def _find_unknown(language: Language, texts: Mapping[str, str], prepared: Program) -> Iterator[str]:
    (name, text), *_ = texts.items()
    if not language.recognise(text) and not name.lower().endswith(language.suffixes):
        yield "the language neither recognises the text nor has the suffix of its file"
    executed = language.run(texts, RunRequest())
    for finding in executed.findings:
        if finding.level == "refused":
            yield f"as a program of any author, line {finding.line} is refused: {finding.what}"
    if executed.stopped is not None:
        line, what = executed.stopped
        yield f"as a program of any author, it stops in line {line}: {what}"
    read = int(Columns(executed.body).moves_are(MoveL, MoveC).sum())
    planned = int(prepared.columns.moves_are(MoveL, MoveC).sum())
    if read != planned:
        lines = counted(read, "straight motion or arc", "straight motions and arcs")
        yield f"as a program of any author, it has {lines} instead of {planned}"


def _find_unseen(kit: _Kit, case: Case, check: _Check, file: OutputFile) -> Iterator[str]:
    lines = check.run({file.name: file.text}).lines
    first_line = int(lines[0]) if case.altered == "body" else 1
    for change in alter_numbers(file.text, first_line):
        try:
            check.run({file.name: change.text})
        except VerifyError:
            continue
        except CamgenError as error:
            yield str(error)
            return
        if not is_excused(change, file.text, kit.meaningless):
            yield f"a changed number is not seen: line {change.line}, {change.what}"


def _find_unfounded(refusal: Refused, program: Program, lacks: Collection[str]) -> Iterator[str]:
    if not refusal.what.strip():
        yield "refused without a reason"
    if refusal.index < 0:
        if not set(WHOLE) & set(lacks):
            lacked = " nor ".join(WHOLE)
            yield f"refused as a whole, though it lacks neither {lacked}: {refusal}"
    elif refusal.index >= len(program.body):
        yield f"refused instruction {refusal.index}, which is not there: {refusal}"
    elif not any(
        FEATURES[name](program.body[refusal.index]) for name in set(lacks) & set(FEATURES)
    ):
        kind = type(program.body[refusal.index]).__name__
        yield f"refused a {kind} that uses nothing the controller is said to lack: {refusal}"


#: Numbers that controllers do not read, or should not get: NaN, an exponent of Python, minus zero.
_BAD_NUMBERS = {
    "NaN or infinity": re.compile(r"(?i)(?:\b|(?<=[=,( ][a-z]))(?:nan|inf)\b"),
    "an exponent": re.compile(r"\d[eE][+-]\d|\d\.\d*[eE]\d"),
    "a minus zero": re.compile(r"-0+(?:\.0*)?(?![\d.])"),
}


def _find_illegal(file: OutputFile, post: type[Post], clean: bool) -> Iterator[str]:
    if not file.name or file.name != file.name.strip() or re.search(r"[/\\\x00-\x1f]", file.name):
        yield f"{file.name!r} is not a file name"
    if not file.name.endswith((post.suffix, *post.data_suffixes)):
        yield f"{file.name} does not end with {' or '.join((post.suffix, *post.data_suffixes))}"
    if not file.text.isascii():
        yield f"{file.name} is not ASCII"
    if re.search(r"[^\n\t -~]", file.text):
        what = "lines end with \\n, the newline of the post is set later"
        yield f"{file.name} has a control character; {what}"
    if not file.text.endswith("\n"):
        yield f"{file.name} does not end with a newline"
    for what, pattern in _BAD_NUMBERS.items():
        for match in list(pattern.finditer(file.text))[: int(clean)]:
            line = file.text.count("\n", 0, match.start()) + 1
            yield f"{file.name} has {what} in line {line}: {file.text.splitlines()[line - 1]}"
