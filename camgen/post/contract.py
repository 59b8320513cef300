"""The contract of posts as tables of members, and the calls that check it.

Camgen calls `prepare` and `render` of a post through this module alone. Their results come from
foreign code, so they are checked here: types by the tables, and the prepared program by
`preparation`.
"""

from __future__ import annotations

import math
import re
from typing import get_args, get_type_hints

from msgspec.structs import asdict

from camgen.model.cell import Cell, Dynamics
from camgen.model.contract import (
    Member,
    be,
    be_all,
    be_between,
    be_each,
    be_empty,
    be_struct,
    be_text,
    be_words,
    check_value,
)
from camgen.model.errors import Refused, VerifyError
from camgen.model.part import Note
from camgen.model.pose import Pose
from camgen.model.program import RULES, Joints, Program
from camgen.post import OutputFile, Post, Tolerance
from camgen.post.limits import find_loose
from camgen.post.passes import PASSES
from camgen.post.preparation import CHANGES, REMEDY, check_preparation
from camgen.post.verify import COMPARED

#: Digits after the point: a double has 15 in all, and a coordinate has up to 6 before the point.
_MOST_DECIMALS = 9
_SUFFIX = re.compile(r"\.[A-Za-z0-9_.-]+")
_NAME = re.compile(r"[A-Za-z0-9_.-]+")
#: The remedy for a fault of a post.
CORRECT_POST = "correct the post"


#: Numbers of a machine that may be 0.
_MAY_BE_ZERO = ("deviation", "pause")


def _find_unreal(dynamics: Dynamics) -> str:
    """Names a number of a machine that is not possible: each is finite, and all but one above 0."""
    for name, value in asdict(dynamics).items():
        if value is None or isinstance(value, (bool, str)):
            continue
        if not isinstance(value, (int, float)) or not math.isfinite(value):
            return f"has {name} = {value!r}, which is not a finite number"
        if value < 0 or (value == 0 and name not in _MAY_BE_ZERO):
            return f"has {name} = {value:g}, which is not above 0"
    return ""


def _find_shared_name(files: tuple[OutputFile, ...]) -> str:
    names = [file.name for file in files]
    return "" if names and len(set(names)) == len(names) else "has no file, or two with one name"


_ENDING = be_text(_SUFFIX.fullmatch, 'a file name ending such as ".txt"')
_WORDS = be_words((set, frozenset), COMPARED, "a set of words")
_TEXT = be(str, "a text")
_FRAME = be(Pose, "a Pose")
_CORNER = be_text(get_args(get_type_hints(Dynamics)["corner"]).__contains__, "a kind of corner")
_NO_AXES = be(type(None), "None; cell.machine states the limits of axes")
_MACHINE = be_struct(
    Dynamics, {"corner": _CORNER, "shares": be(bool, "True or False"), "axes": _NO_AXES}
)
_FILE = be_struct(OutputFile, {"name": _TEXT, "text": _TEXT})

#: The members of the class of a post, checked when it is found.
POST_CLASS: tuple[Member, ...] = (
    Member("__abstractmethods__", be_empty),
    Member("name", be_text(_NAME.fullmatch, "a name of letters, digits and _")),
    Member("suffix", _ENDING),
    Member("about", be_text(str.strip, "a line of text")),
    Member("newline", be_text(("\n", "\r\n", "\r").__contains__, "a line end")),
    Member("data_suffixes", be_each(tuple, _ENDING, "a tuple of file name endings")),
    Member("changes_tools", be(bool, "True or False")),
    Member("passes", be_words(tuple, PASSES, "a tuple of names of passes")),
    Member("verified_fields", _WORDS),
)
#: The members of a post with its options, checked when it is made.
POST: tuple[Member, ...] = (
    Member("program", _TEXT),
    Member("decimals", be_between(0, _MOST_DECIMALS)),
    Member("max_lines", be_between(0)),
    Member("passes", be_words(tuple, PASSES, "a tuple of names of passes")),
    Member("verified_fields", _WORDS),
    Member("list_verified()", _WORDS),
    Member("list_changed()", be_words((set, frozenset), CHANGES, "a set of words")),
    Member("tolerance()", be_all(be_struct(Tolerance, {}), find_loose)),
    Member("held_tool()", _TEXT),
    Member("dynamics()", be_all(_MACHINE, _find_unreal)),
)
CELL = Member(
    "cell()",
    be_struct(
        Cell,
        {
            "name": _TEXT,
            "base_from_work": _FRAME,
            "flange_from_tool": _FRAME,
            "home": be((Joints, Pose), "Joints or a Pose"),
            "robot": _TEXT,
            "pace": be(Dynamics, "a Dynamics"),
        },
    ),
)
PREPARE = Member("prepare()", be(Program, "a Program"))
RENDER = Member(
    "render()", be_all(be_each(tuple, _FILE, "a tuple of OutputFile"), _find_shared_name)
)
WARN = Member("warn()", be_each(tuple, be(Note, "a Note"), "a tuple of Note"))


def name_post(post: Post | type[Post]) -> str:
    """How a message names a post."""
    return f"post {post.name}"


def prepare_program(post: Post, program: Program, chord: float) -> Program:
    """The program in instructions that the controller has, proven to be the same program.

    chord: `tolerance.chord` of the job, mm.

    Raises JobError for a result that is not a Program, and VerifyError for a program that
    is not the same.
    """
    try:
        prepared = post.prepare(program, chord)
    except Refused as error:
        # A post refuses by its own name. A body that breaks a rule of programs is its fault.
        if error.file != RULES:
            raise
        raise VerifyError(
            program.name,
            f"instruction {error.index}: the preparation breaks a rule, {error.what}",
            0,
            REMEDY,
        ) from error
    check_value(name_post(post), PREPARE, prepared, CORRECT_POST)
    check_preparation(program, prepared, chord, post.list_changed())
    return prepared


def render_program(post: Post, prepared: Program) -> tuple[OutputFile, ...]:
    """The files of a prepared program. Raises JobError for a result that is not files."""
    files = post.render(prepared)
    check_value(name_post(post), RENDER, files, CORRECT_POST)
    return files


def list_warnings(post: Post, program: Program) -> tuple[Note, ...]:
    """The notes of a post on a program. Raises JobError for a result that is not notes."""
    notes = post.warn(program)
    check_value(name_post(post), WARN, notes, CORRECT_POST)
    return notes
