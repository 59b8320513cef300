"""Draws jobs at random: a part, a post, and settings of the schema that the program prints.

Which settings there are, with their types, ranges and choices, is read from `camgen schema`. The
texts that a setting takes are not in the schema; `_TEXTS` lists some that a user may write. The
number of values in a list is taken from the example in the description of the setting, such as
`[x, y, z, rx, ry, rz]`.
"""

from __future__ import annotations

import json
import random
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from bench.support.runner import ROOT
from bench.support.timing import python
from camgen.model.toml import format_toml

#: Settings that a job may have beside those of its part.
_MOST_SETTINGS = 5
#: Tables that few parts use are drawn a third as often.
_RARE_TABLES = ("camera", "image", "limits", "page")
#: The arm or machine of each post, which a quarter of the jobs name; without a robot most of the
#: settings of `[cell]` have no effect.
_ROBOTS = {
    "rapid": "IRB 120",
    "pacscript": "VS-060",
    "vplus": "Cobra s600",
    "gcode": "3-axis mill",
    "grbl": "3-axis mill",
}
POSTS = tuple(_ROBOTS)

_CASES = "fixtures/cases"
_GEAR = "fixtures/parts/gear.png"
_PHOTO_SCALE = ("--set", "image.mm_per_px=0.1")
#: The inputs with their job files, as words of the command line. Names are relative to the root.
_INPUTS = (
    ("fixtures/parts/bracket.dxf",),
    ("fixtures/parts/plate.dxf",),
    ("fixtures/parts/layers.dxf",),
    ("fixtures/parts/blocks.dxf",),
    ("fixtures/parts/gaps.dxf",),
    ("fixtures/parts/smooth.dxf", "--job", f"{_CASES}/smooth-passes/job.toml"),
    ("fixtures/parts/copper.dxf", "--job", f"{_CASES}/copper-fill/job.toml"),
    ("fixtures/parts/space.dxf", "--job", f"{_CASES}/space-trace/job.toml"),
    ("fixtures/parts/motor.dxf", "--job", f"{_CASES}/motor-plate/job.toml"),
    ("fixtures/parts/bracket.dxf", "--job", f"{_CASES}/bracket-deburr/job.toml"),
    ("fixtures/parts/bracket.dxf", "--job", f"{_CASES}/bracket-pocket/job.toml"),
    ("fixtures/parts/bracket.dxf", "--job", f"{_CASES}/bracket-tabs/job.toml"),
    ("fixtures/parts/bracket.dxf", "--job", f"{_CASES}/bracket-robot/job.toml"),
    ("fixtures/parts/plate.dxf", "--job", f"{_CASES}/plate-drill/job.toml"),
    ("fixtures/parts/logo.svg", "--job", f"{_CASES}/logo-trace/job.toml"),
    ("fixtures/parts/logo.svg", "--set", "page.size=A4"),
    (_GEAR, "--job", f"{_CASES}/gear-trace/job.toml", *_PHOTO_SCALE),
    (_GEAR, *_PHOTO_SCALE),
    ("fixtures/parts/board.png", "--set", "operation.kind=fill", *_PHOTO_SCALE),
    ("fixtures/parts/rfa1.stl",),
    ("fixtures/parts/rfa1.stl", "--job", f"{_CASES}/rfa1-edges/job.toml"),
    ("fixtures/parts/seam.xyz", "--job", f"{_CASES}/seam-trace/job.toml"),
    (f"{_CASES}/bracket-deburr/expected/part.mod",),
    (f"{_CASES}/bracket-follow/expected/part.pcs",),
    (f"{_CASES}/plate-drill/expected/part.v2",),
    (f"{_CASES}/plate-drill/expected/part.ngc",),
    (f"{_CASES}/smooth-passes/expected/part.nc",),
)

#: Texts for the settings whose choices are not in the schema, by key or by table and key.
_TEXTS = {
    "input.units": ("auto", "mm", "cm", "inch", "ft", "um", "furlong"),
    "input.layers": ("*", "0", "!0", "OUTLINE", "H*", "none"),
    "input.select": ("convex", "all", "bottom", "convex, not bottom", "e1", "e1, e99", ""),
    "operation.last_face": ("top", "f1", "f1, f2", "side"),
    "operations.layers": ("*", "OUTLINE", "!HOLES", "none"),
    "operations.colors": ("red", "1", "#ff0000", "256", "mauve"),
    "operations.ids": ("c1", "c2", "0/1", "none"),
    "operations.tool": ("drill 5.5", "end mill 6", "V 90", "none"),
    "cell.file": ("", "", "missing.toml"),
    "cell.fixtures": ("missing.stl",),
    "image.background": ("", "", "missing.png"),
    "camera.file": ("", "", "missing.yaml"),
    "camera.markers": ("", "A4", "7x5", "none"),
    "process.signal": ("auto", "process", "laser", "spindle", ""),
    "page.size": ("", "A4", "A3 landscape", "letter", "A99"),
    "stock.layer": ("", "0", "OUTLINE", "none"),
    "tour.layers": ("0", "OUTLINE", "none"),
    "tour.order": ("c1", "c2", "none"),
    "post.work": ("G54", "G55", "G59.3", "wPart", "cg.part"),
    "post.tool": ("tPart", "cg.part", "tool one"),
    "post.signals": ("P0", "P63", "M3", "M4", "M7", "M8", "doPart"),
    "post.force_on": ("ForceCtrl True, {n}", "ForceParam {n}, 2, {what}", ""),
    "post.force_off": ("ForceCtrl False", ""),
}
_ANY_TEXTS = ("", "auto", "part 1", "Größe", "9to5", "missing.toml", "x" * 40)
#: Keys of the settings that are tables: names of outputs, and of inputs of a program.
_NAMES = ("process", "spindle", "force", "dout0", "aoSpindle", "di1")
_SPEEDS = ("1200 mm/min", "2.5 m/min", "40 in/min", ".5in/s", "30 mm/s")
#: Numbers that people write.
_COMMON = (0.1, 0.5, 1, 2, 3, 5, 10, 30, 45, 90, 100, 180, 300, 360, 1000)
#: Seconds that a search by the clock may take here, so that it does not look like a hang.
_SEARCH_SECONDS = 0.5


class Setting(NamedTuple):
    """A setting of the schema.

    table: name of its table; `tools` and `operations` have rows.
    key: its name in the table.
    schema: type, range, choices, default and description.
    """

    table: str
    key: str
    schema: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Table and key as the command line takes them."""
        return f"{self.table}.{self.key}"


class Case(NamedTuple):
    """A drawn job.

    number: its place in the sequence of its seed.
    post: name of the post.
    words: the command line after `camgen`, with file names relative to the root.
    """

    number: int
    post: str
    words: tuple[str, ...]


def ask_program(*words: str) -> Any:
    """The output of a command of camgen, from JSON."""
    done = subprocess.run(python("camgen", *words), cwd=ROOT, capture_output=True, check=True)
    return json.loads(done.stdout)


@cache
def list_settings(post: str) -> tuple[Setting, ...]:
    """The settings of a job for `post`, in the order of the schema."""
    settings = []
    for table, schema in ask_program("schema", "--post", post)["properties"].items():
        keys = schema.get("items", schema)["properties"]
        settings += [Setting(table, key, about) for key, about in keys.items()]
    return tuple(settings)


@cache
def list_robots() -> tuple[str, ...]:
    """The robots that the program has built in."""
    return tuple(robot["name"] for robot in ask_program("robots", "--json"))


def draw_case(seed: int, number: int) -> Case:
    """Case `number` of the sequence of `seed`, always the same."""
    chance = random.Random(f"{seed}/{number}")
    post = chance.choice(POSTS)
    part = chance.choice(_INPUTS)
    by_table: dict[str, list[Setting]] = {}
    has_rows = any(word.endswith("motor-plate/job.toml") for word in part)
    for setting in list_settings(post):
        if setting.table not in ("tools", "operations") or has_rows:
            by_table.setdefault(setting.table, []).append(setting)
    words = ["build", *part, "--post", post]
    names = set()
    if chance.random() < 0.25:
        names.add("cell.robot")
        words += ["--set", f"cell.robot={format_toml(_ROBOTS[post])}"]
    usual = [table for table in by_table if table not in _RARE_TABLES]
    tables = [*by_table, *usual, *usual]
    for _ in range(chance.randint(1, _MOST_SETTINGS)):
        setting = chance.choice(by_table[chance.choice(tables)])
        if setting.name in names:
            continue
        names.add(setting.name)
        words += [
            "--set",
            f"{_with_row(setting, chance)}={format_toml(draw_value(setting, chance))}",
        ]
    return Case(number, post, tuple(words))


def _with_row(setting: Setting, chance: random.Random) -> str:
    """The name of a setting; in a table with rows with the number of one of them."""
    rows = {"tools": 3, "operations": 7}.get(setting.table)
    if rows is None:
        return setting.name
    return f"{setting.table}.{chance.randrange(rows)}.{setting.key}"


def draw_value(setting: Setting, chance: random.Random) -> object:
    """A value that the schema allows."""
    if setting.name == "tour.seconds":
        return chance.choice((0, _SEARCH_SECONDS))
    return _draw(setting, setting.schema, chance)


def _draw(setting: Setting, schema: Mapping[str, Any], chance: random.Random) -> object:
    if "anyOf" in schema:
        default = {key: schema[key] for key in ("default",) if key in schema}
        return _draw(setting, default | chance.choice(schema["anyOf"]), chance)
    if "enum" in schema:
        return chance.choice(schema["enum"])
    kind = schema["type"]
    if kind == "boolean":
        return chance.random() < 0.5
    if kind in ("number", "integer"):
        number = _draw_number(schema, chance)
        return round(number) if kind == "integer" else float(f"{number:.6g}")
    if kind == "array":
        size = _draw_size(setting, schema["items"], chance)
        return [_draw(setting, schema["items"], chance) for _ in range(size)]
    if "properties" in schema:
        return {
            name: _draw(setting, values, chance) for name, values in schema["properties"].items()
        }
    if kind == "object":
        values = schema.get("additionalProperties", {"type": "number"})
        names = chance.sample(_NAMES, chance.randint(0, 3))
        return {name: _draw(setting, values, chance) for name in names}
    return _draw_text(setting, schema, chance)


def _draw_number(schema: Mapping[str, Any], chance: random.Random) -> float:
    """A number in the range of `schema`: a bound, a common number, or one of any magnitude."""
    least = schema.get("minimum", schema.get("exclusiveMinimum"))
    largest = schema.get("maximum", schema.get("exclusiveMaximum"))
    default = schema.get("default")
    number = _draw_free_number(default, chance)
    if least is None and chance.random() < 0.4:
        number = -number
    at = chance.random()
    if least is not None and at < 0.1:
        number = least
    if largest is not None and at > 0.9:
        number = largest
    if least is not None:
        number = max(number, least)
    if largest is not None:
        number = min(number, largest)
    # A bound that is not allowed itself: a number close to it.
    if number == schema.get("exclusiveMinimum"):
        return number + 1e-6
    if number == schema.get("exclusiveMaximum"):
        return number - 1e-3
    return number


def _draw_free_number(default: object, chance: random.Random) -> float:
    """A positive number, more often than not of the magnitude of the default."""
    usual = isinstance(default, (int, float)) and default
    if usual and chance.random() < 0.6:
        return abs(float(default)) * 10 ** chance.uniform(-1, 1)
    if chance.random() < 0.6:
        return chance.choice(_COMMON)
    return 10 ** chance.uniform(-4, 6)


def _draw_size(setting: Setting, items: Mapping[str, Any], chance: random.Random) -> int:
    """Number of values for a list: as in the example of the description, or a few.

    items: schema of the values. A list of lists has a few; the example shows one of them.
    """
    if any(choice.get("type") == "array" for choice in (items, *items.get("anyOf", ()))):
        return chance.randint(0, 3)
    example = re.search(r"\[([^\[\]]*)\]", setting.schema.get("description", ""))
    if example and "," in example[1] and chance.random() < 0.85:
        return example[1].count(",") + 1
    return chance.randint(0, 6)


def _draw_text(setting: Setting, schema: Mapping[str, Any], chance: random.Random) -> str:
    if "pattern" in schema:
        return chance.choice(_SPEEDS)
    if setting.key in ("robot", "taught_on"):
        return chance.choice(list_robots())
    known = _TEXTS.get(setting.name) or _TEXTS.get(setting.name.replace("operations", "operation"))
    return chance.choice(known if known and chance.random() < 0.9 else _ANY_TEXTS)
