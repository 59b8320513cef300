"""The programs that are mutated: parts of golden cases, of programs by hand, and of the bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

import camgen
from camgen.model.program import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Program
from camgen.post.plugins import Readback, fill_tables, find_post, find_readback, make_post
from camgen.post.verify import compare
from fixtures.program_text import parse

_FIXTURES = Path(__file__).parents[2] / "fixtures"
#: Largest deviation of the chords that replace an arc, mm. Few chords keep V+ short.
_CHORD_MM, _CHORD_VPLUS_MM = 0.01, 0.2
#: Programs of the bench: a force along the tool on lines and an arc (edge), a force that the post
#: of V+ can switch, with outputs, waits and a blend (pressing), two tools that are changed (tools).
_BY_HAND = Path(__file__).with_name("programs_by_hand")


class Source(NamedTuple):
    """The origin of a program.

    name: a golden case, a program by hand (".ir"), or a program of the bench
    size: maximum number of its instructions
    options: options of the post
    place: index of the mutated file among the files of the program
    """

    name: str
    size: int
    options: Mapping[str, object]
    place: int = 0


class PostedProgram(NamedTuple):
    """A program as its post prints it.

    post, readback: print the program and read it back
    options: options of the post
    prepared: the program that is printed
    file: name of the mutated file
    text: the mutated text
    files: all texts by name
    """

    post: camgen.Post
    readback: Readback
    options: dict[str, object]
    prepared: Program
    file: str
    text: str
    files: Mapping[str, str]

    def replace_text(self, text: str) -> dict[str, str]:
        """All files with another text of the mutated one."""
        return {**self.files, self.file: text}

    def is_caught(self, text: str) -> bool:
        """Whether a build would refuse the text."""
        reading = self.readback(self.replace_text(text), self.options)
        tolerance, verified = self.post.tolerance(), self.post.list_verified()
        try:
            compare(self.prepared, reading, tolerance, verified, self.file)
        except camgen.VerifyError:
            return True
        return False


_SPINNING = {"signals": {"process": "doProcess", "spindle": "aoSpindle"}}
_ON_OFF: dict[str, object] = {"spindle": "on-off", "signals": {"spindle": 25}}
_NAMED = {"glue": 25, "air": 26}
SOURCES: dict[str, tuple[Source, ...]] = {
    "rapid": (
        Source("bracket-follow", 20, {}),
        Source("edge", 40, {"force_load": "lTool", "force_arcs": True}),
        Source("smooth-passes", 14, _SPINNING),
        Source(
            "force.ir", 40, {"force_calibrated": True, "force_change": 20.0, "force_distance": 5.0}
        ),
        Source(
            "turn_on_the_spot.ir",
            40,
            {"mass": 1.5, "cog": [0.0, 1.0, 60.0], "acc_set": [50.0, 80.0]},
        ),
        Source("posture.ir", 40, {"sing_area": "wrist", "s4": True}),
        Source(
            "blend.ir", 40, {"on_error": "exit", "fixture": [400.0, -100.0, 30.0, 0.0, 0.0, 0.0]}
        ),
        Source("frames.ir", 40, {"declare": False}),
        Source("output_named.ir", 40, {"signals": {"glue": "doGlue", "air": "doAir"}}),
    ),
    "pacscript": (
        Source("bracket-follow", 24, {}),
        Source("bracket-deburr", 40, {"force": "template"}),
        Source("smooth-passes", 24, _ON_OFF | {"speed": "percent", "rated": 4000.0}),
        Source("force.ir", 40, {"force": "template", "mps": "mm/s"}),
        Source("turn_on_the_spot.ir", 40, {"define": True, "ext_speed": 50.0}),
        Source("posture.ir", 40, {"mps": "m/s"}),
        Source("pressing", 40, {"pass_mark": "mm", "force": "template"}),
        Source("output_named.ir", 40, {"signals": _NAMED}),
        Source("plate-drill", 20, _ON_OFF),
        Source("wait.ir", 40, {}),
        Source("copper-fill", 40, {"max_lines": 20}),
    ),
    "vplus": (
        Source("bracket-follow", 24, {}),
        Source("bracket-deburr", 40, {"force": "ignore"}),
        Source("smooth-passes", 24, _ON_OFF),
        Source("pressing", 40, {"force": "signal", "signals": {"force": 34}}),
        Source("turn_on_the_spot.ir", 40, {}),
        Source("posture.ir", 40, {}),
        Source("frames.ir", 40, {"declare": False}),
        Source("output_named.ir", 40, {"signals": _NAMED}),
        Source("plate-drill", 30, _ON_OFF | {"posture": ["RIGHTY", "ABOVE"]}),
        Source("copper-fill", 50, {"max_lines": 20}),
        Source("logo-trace", 50, {}),
        Source("bracket-follow", 16, {"points": "file"}),
        Source("bracket-follow", 24, {"points": "file"}, place=1),
        Source("posture.ir", 40, {"points": "file"}, place=1),
    ),
    "gcode": (
        Source("bracket-follow", 60, {"tool": 3}),
        Source("smooth-passes", 90, {}),
        Source("plate-drill", 200, {}),
        Source("plate-drill", 40, {"cycles": False, "path_tolerance": 0.0}),
        Source("pressing", 40, {"force": "analog", "force_scale": 0.1}),
        Source("blocks-trace", 90, {"signals": {"process": "M8"}, "lift": False}),
        Source("copper-fill", 120, {}),
        Source("output_named.ir", 40, {"signals": {"glue": "P1", "air": "P2"}}),
        Source("wait.ir", 40, {"work": "G55"}),
        Source("tools", 40, {}),
        Source("tools", 40, {"lift": False, "work": "G56"}),
    ),
    "grbl": (
        Source("bracket-follow", 60, {}),
        Source("smooth-passes", 90, {"signals": {"process": "M8"}}),
        Source("plate-drill", 60, {"signals": {"process": "M8"}}),
        Source("pressing", 40, {"force": "ignore"}),
        Source("blocks-trace", 90, {"signals": {"process": "M4"}, "power": 800.0}),
        Source("copper-fill", 120, {}),
        Source("spindle.ir", 40, {"signals": {"process": "M8"}}),
        Source("wait.ir", 40, {"work": "G55"}),
    ),
}


@cache
def make(post: str, number: int) -> PostedProgram:
    """Prints a source of `SOURCES`. ValueError if it is not read back without a fault."""
    source = SOURCES[post][number]
    kind = find_post(post)
    poster = make_post(kind, source.options)
    options = fill_tables(kind, source.options)
    prepared = poster.prepare(_cut(source, kind), _CHORD_VPLUS_MM if post == "vplus" else _CHORD_MM)
    files = {file.name: file.text for file in poster.render(prepared)}
    name = list(files)[source.place]
    posted = PostedProgram(poster, find_readback(post), options, prepared, name, files[name], files)
    count = 2 if "points" in source.options else 1
    if len(files) > count or posted.is_caught(posted.text):
        raise ValueError(f"{source.name} for {post}: {len(files)} files, or not read back")
    return posted


def _cut(source: Source, kind: type[camgen.Post]) -> Program:
    """The first instructions of a program, from the home of the post if that is a pose."""
    file = _FIXTURES / "cases" / source.name / "expected" / "plan.ir"
    if source.name.endswith(".ir"):
        file = _FIXTURES / "programs" / source.name
    elif not file.exists():
        file = _BY_HAND / f"{source.name}.ir"
    program = parse(file.read_text(encoding="utf-8"))
    body: list[Instruction] = list(program.body[: source.size])
    home = kind.cell().home
    if isinstance(home, camgen.Pose):
        for number, item in enumerate(body):
            if isinstance(item, MoveJ) and isinstance(item.target, Joints):
                body[number] = replace(item, target=home)
    return program.with_body(_close(body))


def _close(body: Sequence[Instruction]) -> tuple[Instruction, ...]:
    """Stops at the last motion, and switches off the outputs and the force after it."""
    closed = list(body)
    last = 0
    outputs: dict[str, float] = {}
    newtons = 0.0
    for number, item in enumerate(body):
        if isinstance(item, MoveJ | MoveL | MoveC):
            last = number
        elif isinstance(item, Output):
            outputs[item.signal] = item.value
        elif isinstance(item, Force):
            newtons = item.newtons
    closed[last] = replace(closed[last], blend=0.0)
    if newtons:
        closed.append(Force(0.0))
    for name, value in outputs.items():
        if value:
            closed.append(Output(name, 0.0))
    return tuple(closed)
