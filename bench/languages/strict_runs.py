"""Strict runs of long programs, and the size of each language.

    python -m bench.languages.strict_runs [MOTIONS, 100000]

The rule: a program has that many straight motions to points that a generator with the seed 1 draws
from a square of 200 mm. Each fiftieth motion stops, and an output is switched after it. Each post
prints the program with its defaults. Seconds are the minimum of four strict runs, processor time.
Lines and statements are those of the language with its strict profile.
"""

from __future__ import annotations

import ast
import random
import time
from pathlib import Path

from bench.support.runner import open_table, read_words
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveJ, MoveL, Output, Program, switch_off_first
from camgen.post.plugins import find_post, find_readback, make_post

#: The folder of the language of each post.
FOLDERS = {
    "gcode": "gcode",
    "grbl": "gcode",
    "pacscript": "pacscript",
    "rapid": "rapid",
    "vplus": "vplus",
}
_LANG = Path(__file__).parents[2] / "camgen" / "lang"
#: Side of the square, mm, and number of motions between two stops.
_SIDE, _STRETCH = 200.0, 50
_RUNS = 4


def main(count: int) -> None:
    table = open_table("post | instructions {:,} | s {:.3f} | lines {:,} | statements {:,}")
    for post, folder in FOLDERS.items():
        size = measure_size(sorted((_LANG / folder).rglob("*.py")))
        table.add(post, *measure(post, count), *size)
    table.add("engine", 0, 0.0, *measure_size(sorted(_LANG.glob("*.py"))))


def measure(post: str, count: int) -> tuple[int, float]:
    """The number of instructions of the program, and the seconds of its strict run."""
    kind = find_post(post)
    poster, cell = make_post(kind, {}), kind.cell()
    program = Program(
        "part",
        cell.base_from_work,
        cell.flange_from_tool,
        make_body(MoveJ(cell.home, 100.0), count),
    )
    files = {file.name: file.text for file in poster.render(poster.prepare(program, 0.01))}
    read, best, instructions = find_readback(post), float("inf"), 0
    for _ in range(_RUNS):
        begin = time.process_time()
        executed = read(files, {})
        best = min(best, time.process_time() - begin)
        assert not executed.findings
        instructions = len(executed.body)
    return instructions, best


def make_body(home: MoveJ, count: int) -> tuple[Instruction, ...]:
    """The instructions of the program, from home and back."""
    chance = random.Random(1)
    above = Pose(TOOL_DOWN, (0.0, 0.0, 20.0))
    body: list[Instruction] = [home, MoveJ(above, 100.0)]
    for number in range(count):
        place = Pose(TOOL_DOWN, (chance.uniform(0, _SIDE), chance.uniform(0, _SIDE), 0.0))
        is_stop = number % _STRETCH == 0
        body.append(MoveL(place, 20.0, 0.0 if is_stop else 0.3))
        if is_stop:
            body.append(Output("process", float(number // _STRETCH % 2 == 0)))
    stop = MoveL(place, 20.0)
    body += [stop, MoveL(above, 20.0), Output("process", 0.0), home]
    return tuple(switch_off_first(tuple(body)))


def measure_size(files: list[Path]) -> tuple[int, int]:
    """The lines and statements of files."""
    lines = statements = 0
    for file in files:
        text = file.read_text(encoding="utf-8")
        lines += text.count("\n")
        statements += sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(text)))
    return lines, statements


if __name__ == "__main__":
    main(*read_words(100_000))
