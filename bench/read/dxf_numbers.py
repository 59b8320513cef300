"""Damage the numbers of sound DXF drawings, one damage per file, and judge the result of each.

    python -m bench.read.dxf_numbers [FILES, 60] [SEED, 1] [SPELLED, 28]

The drawings are made by ezdxf (R12 to R2018) and hold lines, arcs, circles, polylines with bulges,
ellipses, splines, hatches, texts, nested blocks and arrays. Each damage is a row of `DAMAGES`. The
result of a damaged file is

- right: the contours are those of the sound drawing;
- named: a note that `--strict` refuses names the place of the damage by line or handle, and the
  damaged value where there is one;
- refused: `InputError`, which the command line turns into exit code 2;
- silent: anything else, another exception included. The bench fails if there is one.

A second table has SPELLED sound drawings in unusual spellings: they have to be read like the plain
ones, without a further note. The length of the plain ones is compared with that of the drawn
shapes.
"""

from __future__ import annotations

import io
import logging
import math
import random
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import ezdxf
import numpy as np
from ezdxf import path

import camgen
from bench.read.drawings import measure_length
from bench.support.runner import Cells, Scenario, must_be_none, read_words, run
from bench.support.runner import verdict as met
from camgen.model.files import Source
from camgen.read import dxf
from camgen.read.files import Files

VERSIONS = ("R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018")
#: Kinds whose numbers decide on contours.
GEOMETRY = (
    "LINE",
    "ARC",
    "CIRCLE",
    "LWPOLYLINE",
    "POLYLINE",
    "VERTEX",
    "ELLIPSE",
    "SPLINE",
    "INSERT",
)
#: Group codes of coordinates, radii, angles, knots, bulges and scales.
FLOATS = frozenset(range(10, 60))
#: Deviation below which two contours are the same, mm.
SAME_MM = 1e-6
#: Share by which a length may differ from that of the drawn shapes: curves are read within 0.01 mm.
SAME_LENGTH = 2e-4


class Text(NamedTuple):
    """A drawing as lines without their ends: group code, value, group code, value, ..."""

    lines: list[str]

    def write(self) -> bytes:
        """The bytes of the file."""
        return ("\n".join(self.lines) + "\n").encode("utf-8")

    def tags(self) -> Iterator[tuple[int, int, str]]:
        """Index of the line of the value, group code and value of each tag."""
        for k in range(0, len(self.lines) - 1, 2):
            yield k + 1, int(self.lines[k]), self.lines[k + 1]


class Entity(NamedTuple):
    """An entity of a text.

    kind: its type.
    handle: its handle, "" without one.
    first, after: indices of its first line and of the line after its last one.
    numbers: indices of the lines that hold its numbers, with their group codes.
    """

    kind: str
    handle: str
    first: int
    after: int
    numbers: tuple[tuple[int, int], ...]


class Damage(NamedTuple):
    """A damaged text.

    lines: the text.
    places: texts of which a note has to hold one: line, handle, or the name of a block.
    value: the damaged value, which the note has to hold; "" for a damage without one.
    is_absent: whether an entity is missing that the sound drawing does not have either.
    """

    lines: list[str]
    places: tuple[str, ...]
    value: str = ""
    is_absent: bool = False


# The sound drawings: each adds shapes to a model space and returns their length, mm.


def add_plate(space: Any, rng: random.Random) -> float:
    """A rectangle of lines, and rows of circles and arcs, enough of them to be read by column."""
    corners = [(0.0, 0.0), (120.5, 0.0), (120.5, 80.25), (0.0, 80.25)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        space.add_line(start, end)
    total = 2 * (120.5 + 80.25)
    for k in range(20):
        radius = rng.randint(10, 40) / 16
        x, y = 10 + 11.125 * (k % 10), 20.5 + 30.25 * (k // 10)
        space.add_circle((x, y), radius)
        space.add_arc((x, y), radius + 1.25, 15.5, 130.75)
        total += 2 * math.pi * radius + math.radians(115.25) * (radius + 1.25)
    return total


def add_outlines(space: Any, rng: random.Random) -> float:
    """Polylines with bulges, as the version of the document writes them."""
    total = 0.0
    for k in range(6):
        width, x = rng.randint(80, 200) / 8, 30.5 * k
        rows = [(x, 0.5, 0), (x + width, 0.5, 1.0), (x + width, 10.75, 0), (x, 10.75, 0.5)]
        if space.doc.dxfversion == "AC1009":
            space.add_polyline2d(rows, format="xyb", close=True)
        else:
            space.add_lwpolyline(rows, format="xyb", close=True)
        quarter = 4 * math.atan(0.5)
        arc = 10.25 / (2 * math.sin(quarter / 2)) * quarter
        total += 2 * width + math.pi * 10.25 / 2 + arc
    return total


def add_curves(space: Any, rng: random.Random) -> float:
    """Ellipses and splines; in R12, which has neither, a polyline in space and a line."""
    if space.doc.dxfversion == "AC1009":
        rows = [(0.5, 0.25), (30.125, 0.25), (30.125, 20.5), (0.5, 20.5)]
        space.add_polyline3d([(x, y, 0) for x, y in rows], close=True)
        space.add_line((50.5, 0.5), (80.25, 0.5))
        return 2 * (29.625 + 20.25) + 29.75
    total = 0.0
    for k in range(4):
        major = rng.randint(40, 160) / 8
        ellipse = space.add_ellipse((45.5 * k, 0.25), (major, 0.5), ratio=0.375)
        points = [(45.5 * k + x, 30.5 + y) for x, y in ((0, 0), (8.5, 12), (17, -9.5), (30.25, 6))]
        spline = space.add_open_spline(points, degree=3)
        total += sum(_measure(path.make_path(curve)) for curve in (ellipse, spline))
    return total


def _measure(curve: Any) -> float:
    points = np.array([point.vec2 for point in map(ezdxf.math.Vec3, curve.flattening(1e-4, 64))])
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def add_blocks(space: Any, rng: random.Random) -> float:
    """A block in a block, placed alone and as an array, and entities that are not machined."""
    blocks = space.doc.blocks
    hole, pair = blocks.new("HOLE", base_point=(0.5, 0.25)), blocks.new("PAIR")
    radius = rng.randint(12, 40) / 16
    hole.add_circle((0.5, 0.25), radius)
    hole.add_line((0.5, 4.25), (6.75, 4.25))
    for x in (0.0, 12.5):
        pair.add_blockref("HOLE", (x, 0.5))
    space.add_blockref("PAIR", (3.25, 7.5))
    space.add_blockref("PAIR", (3.25, 37.5), dxfattribs={"rotation": 22.5})
    array = {"column_count": 3, "column_spacing": 30.5, "row_count": 2, "row_spacing": 20.25}
    space.add_blockref("HOLE", (60.5, 7.5), dxfattribs=array)
    space.add_text("1,5 mm", height=2.5)
    if space.doc.dxfversion != "AC1009":
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path([(90.5, 70.25), (99.5, 70.25), (99.5, 78.5)])
    return 10 * (2 * math.pi * radius + 6.25)


MAKERS = (add_plate, add_outlines, add_curves, add_blocks)


def make(number: int, rng: random.Random) -> tuple[Text, float]:
    """Sound drawing `number`, and the length of its shapes, mm."""
    # Without the date and the random identifier of a new document, and without its log.
    ezdxf.options.write_fixed_meta_data_for_testing = True
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)
    document = ezdxf.new(VERSIONS[number % len(VERSIONS)])
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    total = MAKERS[number % len(MAKERS)](space, rng)
    if number % 3 == 0:
        space.add_line((0.5, -10.25), (40.5, -10.25))
        total += 40
    stream = io.StringIO()
    document.write(stream)
    return Text(stream.getvalue().splitlines()), total


def list_entities(text: Text, kinds: tuple[str, ...] = GEOMETRY) -> list[Entity]:
    """The entities of these kinds in blocks and model space."""
    heads = [(k, value) for k, code, value in text.tags() if code == 0]
    heads.append((len(text.lines) + 1, ""))
    entities, section = [], ""
    for (line, kind), (after, _) in pairwise(heads):
        if kind == "SECTION":
            section = text.lines[line + 2]
        if section not in ("BLOCKS", "ENTITIES") or kind not in kinds:
            continue
        rows = [(k, int(text.lines[k - 1])) for k in range(line + 2, after - 1, 2)]
        handle = next((text.lines[k] for k, code in rows if code == 5), "")
        numbers = tuple((k, code) for k, code in rows if code in FLOATS)
        entities.append(Entity(kind, handle, line - 1, after - 1, numbers))
    return entities


def choose(text: Text, rng: random.Random, written: str = "") -> tuple[Entity, int, int]:
    """An entity, and one of its numbers: index of its line and group code.

    written: characters that the number has to hold.
    """
    entities = list_entities(text)
    while True:
        entity = rng.choice(entities)
        numbers = [row for row in entity.numbers if written in text.lines[row[0]]]
        if numbers:
            return entity, *rng.choice(numbers)


def name_places(entity: Entity, line: int) -> tuple[str, ...]:
    """Texts by which a note may name a place: its line, counted from 1, or the handle."""
    return (f"line {line + 1}", *([f"#{entity.handle}"] if entity.handle else []))


# The damages.

Damager = Callable[[Text, random.Random], Damage]


def replace_one(spell: Callable[[str], str], written: str = "") -> Damager:
    """One number of one entity is spelled otherwise."""

    def damage(text: Text, rng: random.Random) -> Damage:
        entity, line, _ = choose(text, rng, written)
        value = spell(text.lines[line].strip())
        lines = [*text.lines[:line], value, *text.lines[line + 1 :]]
        return Damage(lines, name_places(entity, line), value)

    return damage


def with_commas(text: Text, _: random.Random) -> Damage:
    """All numbers with a fraction have a comma for their point."""
    lines = list(text.lines)
    for k, code, value in text.tags():
        if code in FLOATS or 140 <= code < 150 or 210 <= code < 240 or 1010 <= code < 1060:
            lines[k] = value.replace(".", ",")
    return Damage(lines, ())


def spoil_integer(value: str) -> Damager:
    """A flag or a count of an entity is `value`."""

    def damage(text: Text, rng: random.Random) -> Damage:
        rows = []
        for entity in list_entities(text):
            for k in range(entity.first + 2, entity.after, 2):
                if text.lines[k].strip() in ("62", "66", "70", "71", "72", "73", "90"):
                    rows.append((entity, k + 1))
        if not rows:
            entity = rng.choice(list_entities(text))
            lines = [*text.lines[: entity.first + 2], " 62", value, *text.lines[entity.first + 2 :]]
            return Damage(lines, name_places(entity, entity.first + 3), value)
        entity, line = rng.choice(rows)
        lines = [*text.lines[:line], value, *text.lines[line + 1 :]]
        return Damage(lines, name_places(entity, line), value)

    return damage


def lose_lines(before: int, after: int) -> Damager:
    """Lines from `before` lines above a value to `after` lines below it are gone."""

    def damage(text: Text, rng: random.Random) -> Damage:
        entity, line, _ = choose(text, rng)
        lines = [*text.lines[: line - before], *text.lines[line + after :]]
        places = name_places(entity, line)
        lines_of_entity = range(entity.first + 1, entity.after + 2)
        return Damage(lines, (*places, *(f"line {k}" for k in lines_of_entity)))

    return damage


def lose_group(text: Text, rng: random.Random) -> Damage:
    """A group that its kind cannot do without is gone: coordinates and radii."""
    required = {"LINE": (10, 20, 11, 21), "CIRCLE": (10, 20, 40), "ARC": (10, 20, 40, 50, 51)}
    required |= {"VERTEX": (10, 20), "LWPOLYLINE": (10, 20), "INSERT": (10, 20)}
    required |= {"SPLINE": (10, 20, 40), "ELLIPSE": (10, 20, 11, 21, 40)}
    while True:
        entity, line, code = choose(text, rng)
        if code in required.get(entity.kind, ()):
            lines = [*text.lines[: line - 1], *text.lines[line + 1 :]]
            return Damage(lines, name_places(entity, line))


def repeat_group(text: Text, rng: random.Random) -> Damage:
    """A group that its kind has once stands twice, with different values."""
    once = {"LINE": (10, 20, 11, 21), "CIRCLE": (10, 20, 40), "ARC": (10, 20, 40, 50, 51)}
    once |= {"INSERT": (10, 20, 41, 50), "ELLIPSE": (10, 20, 40), "VERTEX": (10, 20, 42)}
    entities = [e for e in list_entities(text) if e.kind in once]
    if not entities:
        return replace_one(lambda value: f"{value} {value}")(text, rng)
    entity = rng.choice(entities)
    line, code = rng.choice([row for row in entity.numbers if row[1] in once[entity.kind]])
    other = f"{float(text.lines[line]) + 3.5}"
    lines = [*text.lines[: line + 1], f"{code:3d}", other, *text.lines[line + 1 :]]
    return Damage(lines, (*name_places(entity, line), f"line {line + 3}"))


def lose_block(text: Text, rng: random.Random) -> Damage:
    """An INSERT names a block that is not in the file; text without INSERT gets one."""
    inserts = list_entities(text, ("INSERT",))
    lines = list(text.lines)
    if inserts:
        entity = rng.choice(inserts)
        line = next(k for k in range(entity.first + 2, entity.after, 2) if lines[k].strip() == "2")
        lines[line + 1] = "GONE"
        return Damage(lines, (*name_places(entity, line + 1), "GONE"))
    entity = [entity for entity in list_entities(text) if entity.kind != "VERTEX"][-1]
    insert = ["  0", "INSERT", "  8", "0", "  2", "GONE", " 10", "1.5", " 20", "2.5", " 30", "0.0"]
    lines = [*lines[: entity.first], *insert, *lines[entity.first :]]
    return Damage(lines, ("GONE",), is_absent=True)


def lose_block_and_number(text: Text, rng: random.Random) -> Damage:
    """An INSERT without its block in a file that has a damaged number in its header, too."""
    damage = lose_block(text, rng)
    line = damage.lines.index("$LTSCALE") + 2
    damage.lines[line] = "1.#QNAN"
    return damage


def cut_short(text: Text, rng: random.Random) -> Damage:
    """The file ends within an entity of model space, at a line or within one."""
    last = text.lines.index("ENTITIES")
    entities = [entity for entity in list_entities(text) if entity.first > last]
    entity = rng.choice(entities[len(entities) // 2 :])
    line = rng.randrange(entity.first, entity.after)
    rest = text.lines[line]
    return Damage([*text.lines[:line], rest[: rng.randint(0, len(rest))]], ("ends before its end",))


def spoil_header(text: Text, rng: random.Random) -> Damage:
    """A number outside of blocks and model space: of a header variable or a table."""
    end = text.lines.index("BLOCKS")
    rows = [k for k, code, value in text.tags() if k < end and code in FLOATS and "." in value]
    line = rng.choice(rows)
    lines = [*text.lines[:line], "-1.#IND", *text.lines[line + 1 :]]
    return Damage(lines, (f"line {line + 1}",), "-1.#IND")


DAMAGES: dict[str, Damager] = {
    "decimal commas throughout": with_commas,
    "decimal comma in one number": replace_one(lambda value: value.replace(".", ","), "."),
    "-1.#IND": replace_one(lambda _: "-1.#IND"),
    "1.#INF": replace_one(lambda _: "1.#INF"),
    "nan": replace_one(lambda _: "nan"),
    "-inf": replace_one(lambda _: "-inf"),
    "number with an exponent": replace_one(lambda value: f"{float(value):.16e}"),
    "exponent with D": replace_one(lambda value: f"{float(value):.9E}".replace("E", "D")),
    "exponent without digits": replace_one(lambda value: f"{value}e"),
    "empty value": replace_one(lambda _: ""),
    "text for a number": replace_one(lambda _: "unset"),
    "text in a number": replace_one(lambda value: f"{value[:2]}x{value[2:]}"),
    "unit after a number": replace_one(lambda value: f"{value}mm"),
    "thousands with a comma": replace_one(lambda value: f"1,{abs(float(value)) + 100:07.3f}"),
    "thousands with a blank": replace_one(lambda value: f"1 {abs(float(value)) + 100:07.3f}"),
    "thousands with an underscore": replace_one(lambda value: f"1_{abs(float(value)) + 100:07.3f}"),
    "hexadecimal number": replace_one(lambda _: "0x1A"),
    "two points": replace_one(lambda value: f"{value}.5", "."),
    "exponent too large": replace_one(lambda _: "1e999"),
    "integer too large": spoil_integer("99999999999"),
    "text for an integer": spoil_integer("1x"),
    "line of a value lost": lose_lines(0, 1),
    "line of a group code lost": lose_lines(1, 0),
    "group lost": lose_group,
    "group twice": repeat_group,
    "INSERT without its block": lose_block,
    "INSERT without its block, damaged header": lose_block_and_number,
    "file cut short": cut_short,
    "number of the header or a table": spoil_header,
}


# Sound spellings.


def respell(spell: Callable[[str], str]) -> Callable[[Text], bytes]:
    """All numbers of blocks and model space in another spelling."""

    def write(text: Text) -> bytes:
        lines = list(text.lines)
        for entity in list_entities(text):
            for line, _ in entity.numbers:
                lines[line] = spell(lines[line].strip())
        return Text(lines).write()

    return write


def add_comments(text: Text) -> bytes:
    """A comment before each of the first entities."""
    lines = list(text.lines)
    for entity in reversed(list_entities(text)[:5]):
        lines[entity.first : entity.first] = ["999", "1,5 or nan"]
    return Text(lines).write()


SPELLINGS: dict[str, Callable[[Text], bytes]] = {
    "as written": Text.write,
    "carriage returns": lambda text: text.write().replace(b"\n", b"\r\n"),
    "blanks around numbers": respell(lambda value: f"   {value}  "),
    "exponents": respell(lambda value: f"{float(value):.16E}"),
    "plus signs": respell(lambda value: value if value.startswith("-") else f"+{value}"),
    "no zero after the point": respell(lambda value: re.sub(r"\.0$", ".", value)),
    "comments": add_comments,
    "text after the end mark": lambda text: text.write() + b"1,5\nnot a group code\n",
}


# The judgement.


def read(data: bytes) -> camgen.Part:
    return dxf.read(Source(Path("part.dxf"), data), camgen.Job(), Files())


def are_same(first: tuple[camgen.Contour, ...], second: tuple[camgen.Contour, ...]) -> bool:
    """Whether two drawings have the same contours in the same order."""
    if len(first) != len(second):
        return False
    for a, b in zip(first, second, strict=True):
        if a.closed != b.closed or a.points.shape != b.points.shape:
            return False
        if not np.allclose(a.points, b.points, rtol=0, atol=SAME_MM):
            return False
        if not np.allclose(a.bulges, b.bulges, rtol=0, atol=SAME_MM):
            return False
    return True


def compare_damage(damage: Damage, sound: camgen.Part) -> tuple[str, str]:
    """The result of a damaged file, as one of the words above, and the message or notes."""
    try:
        part = read(Text(damage.lines).write())
    except camgen.InputError as error:
        return "refused", str(error)
    except Exception as error:
        return "silent", f"{type(error).__name__}: {error}"
    if are_same(part.contours, sound.contours) and not damage.is_absent:
        return "right", ""
    notes = [str(note) for note in part.notes if note.fails_strict]
    for note in notes:
        if damage.value in note and any(place in note for place in damage.places):
            return "named", note
    return "silent", "; ".join(notes) or "no note"


def count_outcomes(files: int, seed: int) -> tuple[list[Cells], list[Cells]]:
    """The rows of the damages, the last one that of all files; and those of silent differences."""
    results: dict[str, Counter[str]] = {name: Counter() for name in DAMAGES}
    silent: list[Cells] = []
    for number in range(files):
        rng = random.Random(f"{seed} {number}")
        name = list(DAMAGES)[number % len(DAMAGES)]
        # Every kind meets every drawing, and every version in turn.
        text, _ = make(number + number // len(DAMAGES), rng)
        damage = DAMAGES[name](text, rng)
        word, shown = compare_damage(damage, read(text.write()))
        results[name][word] += 1
        if word == "silent":
            silent.append((f"{number}", f"{name}: {damage.value} {damage.places[:2]}", shown[:200]))
    results["all"] = sum(results.values(), Counter())
    rows: list[Cells] = []
    for name, counts in results.items():
        if counts:
            words = [counts[word] for word in ("right", "named", "refused")]
            rows.append((name, counts.total(), *words, must_be_none(counts["silent"])))
    return rows, silent


def measure_spellings(drawings: int, seed: int) -> Iterator[Cells]:
    """One row per spelling: drawings, and how many are read like the plain ones."""
    sound: list[tuple[Text, camgen.Part, float]] = []
    for number in range(drawings):
        text, total = make(number, random.Random(f"{seed} {number}"))
        sound.append((text, read(text.write()), total))
    errors = []
    for _, part, total in sound:
        errors.append(abs(sum(map(measure_length, part.contours)) / total - 1))
    for name, spell in SPELLINGS.items():
        parts = [read(spell(text)) for text, _, _ in sound]
        pairs = list(zip(parts, sound, strict=True))
        alike = sum(are_same(part.contours, plain.contours) for part, (_, plain, _) in pairs)
        noted = sum(part.notes != plain.notes for part, (_, plain, _) in pairs)
        is_met = alike == len(pairs) and not noted and max(errors) < SAME_LENGTH
        yield name, len(pairs), alike, noted, 1e6 * max(errors), met(is_met)


def main() -> int:
    files, seed, spelled = read_words(60, 1, 28)
    rows, silent = count_outcomes(files, seed)
    damages = "damage | files {} | right {} | named {} | refused {} | silent"
    columns = "sound drawings | files {} | read alike {} | with another note {}"
    columns += " | length off, ppm {:.0f} | goal"
    scenarios = [
        Scenario(damages, [()], lambda: rows),
        Scenario(columns, [(spelled, seed)], measure_spellings),
    ]
    if silent:
        scenarios.append(Scenario("file | damage | result", [()], lambda: silent))
    return run(*scenarios)


if __name__ == "__main__":
    sys.exit(main())
