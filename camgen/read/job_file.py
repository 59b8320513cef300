"""Job files and ``--set``: TOML or plain mappings to a checked ``Job``."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.job import (
    SPEED_UNITS,
    Choice,
    Job,
    OperationTable,
    ProcessTable,
    Step,
    ToolRow,
    ToolTable,
)
from camgen.model.job_tables import (
    FILES,
    ROWS,
    Setting,
    defaults_beside,
    has_speed,
    list_keys,
    list_row_settings,
    list_settings,
    list_tables,
    split_name,
)
from camgen.model.limits import Limits, format_limit
from camgen.model.plugins import OPERATIONS, list_entries
from camgen.model.text import counted, suggest
from camgen.read.colors import BASIC, resolve_named
from camgen.read.files import Files

#: So much of a setting is told.
_LONGEST = 100

#: A number and its unit.
_SPEED = re.compile(r"([0-9]{1,12}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})\s*([a-z]+/[a-z]+)")

#: Settings of [process] that no single operation has.
_WHOLE_PROGRAM = ("acceleration", "turn", "max_feed")

#: The tables of a job by name; rows of ``[[operations]]`` are ``operations.0`` and on.
Tree = dict[str, dict[str, object]]
Origins = Mapping[tuple[str, str], str]


def load(file: Path | None, sets: Sequence[str] = (), files: Files | None = None) -> Job:
    """The job of a TOML file (defaults without one) with ``table.key=value`` settings, which win. JobError.

    files: what has been read already.
    """
    files = files or Files()
    tree: Tree = {}
    origins: dict[tuple[str, str], str] = {}
    if file is not None:
        tree = _tables_of(_toml(file, files), str(file))
        _from_its_folder(tree, file.parent)
        origins = {(table, key): str(file) for table, keys in tree.items() for key in keys}
    for text in sets:
        table, key, value = assignment(text)
        if "." in table and table not in tree:
            name = table.partition(".")[0]
            count = sum(one.startswith(f"{name}.") for one in tree)
            what = f"there is no {table}: the job has {counted(count, 'row')} of [[{name}]]"
            raise JobError(f"--set {text}", what, remedy="they are counted from 0")
        tree.setdefault(table, {})[key] = value
        origins[table, key] = f"--set {text if len(text) <= _LONGEST else text[:_LONGEST] + '...'}"
    _fill_from_files(tree, origins, files)
    return _convert(tree, origins, str(file) if file else "job")


def _fill_from_files(tree: Tree, origins: dict[tuple[str, str], str], files: Files) -> None:
    """Add what `cell.file` and `tool.file` say and the job does not.

    The names of the two files are taken out of `tree`: they are of no more use.
    """
    _fill_cell(tree, origins, files)
    _fill_tools(tree, origins, files)


def _fill_cell(tree: Tree, origins: dict[tuple[str, str], str], files: Files) -> None:
    name = _take_file(tree, "cell", origins)
    if not name:
        return
    other = _tables_of(_toml(Path(name), files, "cell.file"), name)
    for table in other:
        if table != "cell":
            raise JobError(
                name, f"[{table}] stands in the file of a cell", remedy="keep [cell] alone in it"
            )
    if "file" in other.get("cell", {}):
        raise JobError(name, "names a file itself", "[cell]", "put all of the cell into one file")
    _from_its_folder(other, Path(name).parent)
    cell = tree["cell"]
    for key, value in other.get("cell", {}).items():
        if key not in cell:
            cell[key] = value
            origins["cell", key] = name


def _take_file(tree: Tree, table: str, origins: Origins) -> str:
    """Remove the key `file` from a table and return its value, "" without one.

    Raises JobError for a value that is not a text.
    """
    name = tree.get(table, {}).pop("file", "")
    if isinstance(name, str):
        return name
    origin = origins.get((table, "file"), "job")
    raise JobError(origin, f"file must be a text, not {_quote_short(name)}", f"[{table}]")


def _fill_tools(tree: Tree, origins: dict[tuple[str, str], str], files: Files) -> None:
    """Lay the tools of the job over those of `tool.file`, by name.

    The tools of the library come first, in its order, those that the job adds after them. A tool
    of the job keeps its table name, so that messages and `--set` count the rows of the job.
    """
    name = _take_file(tree, "tool", origins)
    if not name:
        return
    library = _read_tools(name, files)
    of_job = {str(keys.get("name")): table for table, keys in _rows(tree, "tools")}
    rows: Tree = {}
    for place, tool in enumerate(library):
        table = of_job.get(str(tool["name"]), f"tools.{name}:{place}")
        keys = tree.get(table, {})
        rows[table] = tool | keys
        origins.update({(table, key): name for key in tool if key not in keys})
    for table, keys in _rows(tree, "tools"):
        rows.setdefault(table, keys)
        tree.pop(table)
    tree.update(rows)


def _read_tools(name: str, files: Files) -> list[dict[str, object]]:
    """The rows of a library of tools, each checked. JobError."""
    library = _tables_of(_toml(Path(name), files, "tool.file"), name)
    for table in library:
        if not table.startswith("tools."):
            what = f"{_place(table)} stands in a library of tools"
            raise JobError(name, what, remedy="keep [[tools]] alone in it")
    if not library:
        raise JobError(name, "holds no [[tools]]", "tool.file", "add one, or leave tool.file out")
    _convert(library, {}, name)
    for table, tool in library.items():
        if not tool.get("name"):
            what = "a tool of a library has no name"
            raise JobError(name, what, _place(table), "name it: jobs find it by its name")
    return list(library.values())


def _from_its_folder(tree: Tree, folder: Path) -> None:
    """Files that a job file names lie beside it."""
    for table, key in FILES:
        name = tree.get(table, {}).get(key)
        if (
            isinstance(name, str)
            and name
            and ((table, key) != ("cell", "robot") or split_name(name))
        ):
            tree[table][key] = str(folder / name)
    fixtures = tree.get("cell", {}).get("fixtures")
    if isinstance(fixtures, list):
        tree["cell"]["fixtures"] = [
            str(folder / one) if isinstance(one, str) else one for one in fixtures
        ]


def beside(file: str | None, source: Path | None) -> Path | None:
    """The job file to use: the one named, else ``STEM.toml`` beside the input where there is one."""
    if file is not None or source is None:
        return None if file is None else Path(file)
    try:
        found = source.with_suffix(".toml")
        return found if found.is_file() and found != source else None
    except (OSError, ValueError):  # a name that no file can have: reading it says so
        return None


def from_mapping(tables: Mapping[str, object], files: Files | None = None) -> Job:
    """The job of nested mappings, as ``camgen.build`` takes it. JobError. files: what has been read already."""
    tree = _tables_of({name: _plain(content) for name, content in tables.items()}, "job")
    origins: dict[tuple[str, str], str] = {}
    _fill_from_files(tree, origins, files or Files())
    return _convert(tree, origins, "job")


def _plain(value: object) -> object:
    """``value`` with the numbers and lists of numpy as those of Python."""
    if isinstance(value, Mapping):
        return {key: _plain(content) for key, content in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _toml(file: Path, files: Files, setting: str = "--job") -> dict[str, Any]:
    """The tables of a file. JobError. setting: the one that names the file."""
    try:
        return tomllib.loads(files.open(file).data.decode("utf-8-sig"))
    except OSError as error:
        what = f"cannot be read: {error.strerror}"
        raise JobError(str(file), what, setting, "give a file that can be read") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise JobError(
            str(file), "is not UTF-8 text", f"line {line}", "save it as UTF-8"
        ) from error
    except tomllib.TOMLDecodeError as error:
        what, _, where = str(error).partition(" (at ")
        raise JobError(
            str(file), f"is not TOML: {what}", where.rstrip(")"), "mend this line"
        ) from error
    except RecursionError as error:
        raise JobError(str(file), "is nested too deeply") from error
    except ValueError as error:  # Python reads no number of thousands of digits
        raise JobError(str(file), "holds a number of too many digits", remedy="mend it") from error


def _tables_of(tree: Mapping[str, object], origin: str) -> Tree:
    """``tree`` with its tables checked to be known and to be tables."""
    result: Tree = {}
    for name, content in tree.items():
        if name in ROWS:
            result |= _rows_of(name, content, origin)
            continue
        if name not in list_tables():
            raise _unknown_table(name, origin, content)
        if not isinstance(content, Mapping):
            raise JobError(
                origin,
                f"{name} must be a table, not {_quote_short(content)}",
                remedy=f"write [{name}]",
            )
        result[name] = dict(content)
    return result


def _rows_of(name: str, content: object, origin: str) -> Tree:
    if not isinstance(content, list) or not all(isinstance(row, Mapping) for row in content):
        raise JobError(
            origin,
            f"{name} must be tables, not {_quote_short(content)}",
            remedy=f"write [[{name}]]",
        )
    return {f"{name}.{place}": dict(row) for place, row in enumerate(content)}


def _unknown_table(name: str, origin: str, content: object) -> JobError:
    homes = [s.table for s in list_settings() if s.key == name]
    if homes and not isinstance(content, Mapping):
        return JobError(
            origin, f"{_quote(name)} stands outside its table", remedy=f"it belongs to [{homes[0]}]"
        )
    near = suggest(
        str(name), [*(f"[{one}]" for one in list_tables()), *(f"[[{one}]]" for one in ROWS)]
    )
    return JobError(origin, f"unknown table [{_clean(name)}]", remedy=near)


def assignment(text: str) -> tuple[str, str, object]:
    """Table, key and value of ``table.key=value``; ``operations.0`` is the table of a row. JobError."""
    name, equals, raw = text.partition("=")
    table, dot, key = (part.strip() for part in name.partition("."))
    origin = f"--set {text}"
    if table in ROWS:
        place, dot, key = (part.strip() for part in key.partition("."))
        table = f"{table}.{place}"
    if not (equals and dot and table and key):
        names = [f"{s.table}.{s.key}" for s in list_settings()]
        homes = [one for one in names if one.endswith(f".{table}")]
        raise JobError(
            origin,
            "is not table.key=value",
            remedy=suggest(name, homes or names) if name else "write tool.diameter=5",
        )
    if table not in list_tables() and table.partition(".")[0] not in ROWS:
        raise _unknown_table(table, origin, {})
    return table, key, value_of(raw)


def value_of(raw: str) -> object:
    """``raw``, typed by a user, as TOML, else as the text it is."""
    try:
        parsed = tomllib.loads(f"value = {raw}")
    except (ValueError, RecursionError):  # no TOML, or a number of too many digits
        return raw
    return parsed["value"] if len(parsed) == 1 else raw


def _convert(tree: Tree, origins: Origins, source: str) -> Job:
    for table, keys in tree.items():
        known = list_keys(table) if table != "post" else keys
        for key, value in keys.items():
            origin = origins.get((table, key), source)
            if key not in known:
                raise _unknown_key(table, key, origin)
            if isinstance(value, str) and has_speed(table.partition(".")[0], key):
                keys[key] = _in_mm_s(value, key, _Where(table, origins, source))
            if not all(math.isfinite(number) for number in _floats(keys[key])):
                raise JobError(
                    origin, f"{key} must be finite, not {_quote_short(value)}", _place(table)
                )
    limits = _table(Limits, tree.get("limits", {}), _Where("limits", origins, source))
    _insist_on_numbers(tree, origins, source, limits.number)
    for (table, key), value in defaults_beside(tree).items():
        tree[table] = {key: value} | tree.get(table, {})
    kinds = {
        name: kind
        for name, kind in get_type_hints(Job).items()
        if name not in ("post", "operation", *ROWS)
    }
    made = {
        name: _table(kind, tree.get(name, {}), _Where(name, origins, source))
        for name, kind in kinds.items()
    }
    operation = _operation(tree.get("operation", {}), _Where("operation", origins, source))
    job = Job(**made, operation=operation, post=tree.get("post", {}))
    _insist_on_settings(job, _Where("operation", origins, source))
    return replace(job, **_several(tree, job, origins, source))


class _Where(Struct, frozen=True):
    """Of what table something is said, and who said what."""

    table: str
    origins: Origins
    source: str

    def fault(self, key: str, what: str, remedy: str = "") -> JobError:
        return JobError(
            self.origins.get((self.table, key), self.source), what, _place(self.table), remedy
        )


def _place(table: str) -> str:
    """A table as it stands in a file; a row with its number from 0, as ``--set`` names it."""
    name, dot, row = table.partition(".")
    return f"[[{name}]] {row.rpartition(':')[2]}" if dot else f"[{name}]"


def _settings_of(table: str) -> dict[str, Setting]:
    name, dot, _ = table.partition(".")
    return {s.key: s for s in (list_row_settings() if dot else list_settings()) if s.table == name}


Kind = TypeVar("Kind", bound=Struct)


def _table(kind: type[Kind], keys: Mapping[str, object], where: _Where) -> Kind:
    """The table of ``keys``, checked."""
    try:
        return msgspec.convert(keys, kind)
    except msgspec.ValidationError as error:
        place = re.search(r"`\$\.(\w+)", str(error))
        if place is None:
            raise JobError(where.source, str(error)) from error
        key = place.group(1)
        allowed, value = _settings_of(where.table)[key].allowed, keys[key]
        alone = allowed.startswith("a list of") and isinstance(value, (str, int, float))
        remedy = f"write [{_quote_short(value)}]" if alone else ""
        raise where.fault(
            key, f"{key} must be {allowed}, not {_quote_short(value)}", remedy
        ) from error


def _in_mm_s(value: str, key: str, where: _Where) -> float:
    """A speed given as a text with its unit, in mm/s."""
    found = _SPEED.fullmatch(value.strip())
    if found is None or found[2] not in SPEED_UNITS:
        what = f"{key} must be a number in mm/s or a text with its unit, not {_quote_short(value)}"
        raise where.fault(key, what, f'write "1200 mm/min"; units: {", ".join(SPEED_UNITS)}')
    return float(found[1]) * SPEED_UNITS[found[2]]


def _operation(keys: Mapping[str, object], where: _Where) -> OperationTable:
    """``kind`` may also name an operation that another package brings."""
    kind = keys.get("kind")
    known = get_args(get_args(get_type_hints(OperationTable, include_extras=True)["kind"])[0])
    if kind in known or kind not in [
        entry.name for entry in list_entries(OPERATIONS)
    ]:  # a kind of any type at all
        return _table(OperationTable, keys, where)
    return replace(_table(OperationTable, {**keys, "kind": "auto"}, where), kind=kind)


def _several(tree: Tree, job: Job, origins: Origins, source: str) -> dict[str, object]:
    """The tools and the operations of a job that has several."""
    rows = [
        (_Where(name, origins, source), _table(ToolRow, keys, _Where(name, origins, source)))
        for name, keys in _rows(tree, "tools")
    ]
    _check_distinct(rows)
    tools = [tool for _, tool in rows]
    steps = [
        _step(tree, job, tools, keys, _Where(name, origins, source))
        for name, keys in _rows(tree, "operations")
    ]
    return {"tools": tools, "operations": steps}


def _check_distinct(rows: Sequence[tuple[_Where, ToolRow]]) -> None:
    """Raise JobError for two tools with one name or number.

    Names and numbers of a library are distinct, so the error is about a row of the job.
    """
    known: set[tuple[str, object]] = set()
    for where, tool in sorted(rows, key=lambda row: _is_of_job(row[0].table)):
        for key, value in (("name", tool.name), ("number", tool.number)):
            if value and (key, value) in known:
                raise where.fault(
                    key, f"{key} {_quote_short(value)} is another tool's too", "give each its own"
                )
            known.add((key, value))


def _is_of_job(table: str) -> bool:
    """Whether a row stands in the job itself, and not in its library of tools."""
    return table.partition(".")[2].isdigit()


def _rows(tree: Tree, name: str) -> list[tuple[str, dict[str, object]]]:
    return [(table, keys) for table, keys in tree.items() if table.startswith(f"{name}.")]


def _step(
    tree: Tree, job: Job, tools: list[ToolRow], keys: dict[str, object], where: _Where
) -> Step:
    """One row of ``[[operations]]``: what it does not say is that of its tool, of [operation] and of [process]."""
    choice = _table(Choice, _only(keys, Choice), where)
    _insist_on_colors(choice, where)
    tool, own = job.tool, dict[str, object]()
    if choice.tool or tools:
        row = next(
            (tool for tool in tools if choice.tool in (tool.name, tool.number) and choice.tool),
            None,
        )
        if row is None:
            named = [tool.name or tool.number for tool in tools]
            what = (
                f"there is no tool {_quote_short(choice.tool)}" if choice.tool else "names no tool"
            )
            raise where.fault(
                "tool", what, f"one of {', '.join(map(str, named))}" if named else "write [[tools]]"
            )
        values = {"feed": row.feed, "plunge": row.plunge, "spindle": row.speed}
        own = {key: value for key, value in values.items() if value is not None}
        tool = ToolTable(**{name: getattr(row, name) for name in ToolTable.__struct_fields__})
    for key in _WHOLE_PROGRAM:
        if key in keys:
            raise where.fault(key, f"{key} holds for the whole program", "set it in [process]")
    operation = _operation(tree.get("operation", {}) | _only(keys, OperationTable), where)
    process = _table(ProcessTable, tree.get("process", {}) | own | _only(keys, ProcessTable), where)
    _insist_on_settings(replace(job, operation=operation), where)
    if operation.kind == "auto":
        # The sides of a contour follow from the contours of other operations, by their kinds.
        on_page = bool(job.page.size) and operation.planner != "image"
        operation = replace(operation, kind="trace" if on_page else "follow")
    return Step(tool, operation, process, choice)


def _insist_on_colors(choice: Choice, where: _Where) -> None:
    """JobError for a color that nobody knows."""
    for name in choice.colors:
        if not resolve_named(name):
            remedy = f'one of {", ".join(BASIC)}, a number of DXF from 1 to 255, or "#rrggbb"'
            raise where.fault("colors", f"there is no color {_quote_short(name)}", remedy)


def _only(keys: Mapping[str, object], kind: type[Struct]) -> dict[str, object]:
    return {key: value for key, value in keys.items() if key in kind.__struct_fields__}


def _insist_on_numbers(tree: Tree, origins: Origins, source: str, most: float) -> None:
    """JobError for a number that no machine has; a seed is none of a machine, nor is a limit."""
    for table, keys in tree.items():
        for key, value in keys.items():
            if (
                table in ("post", "limits")
                or key == "seed"
                or all(abs(number) <= most for number in _numbers(value))
            ):
                continue
            what = f"{key} cannot be beyond {format_limit(most)}: {_quote_short(value)}"
            remedy = "give a value that can be meant, or raise limits.number"
            raise JobError(origins.get((table, key), source), what, _place(table), remedy)


def _insist_on_settings(job: Job, where: _Where) -> None:
    """JobError for a setting that is beyond a limit of the same job."""
    operation, limits = job.operation, job.limits
    found = (
        (where, "passes", operation.passes, operation.passes > limits.passes),
        (where, "stepover", operation.stepover, operation.stepover < limits.stepover),
        (
            replace(where, table="tolerance"),
            "chord",
            job.tolerance.chord,
            job.tolerance.chord < limits.chord,
        ),
    )
    for place, key, value, beyond in found:
        if beyond:
            most = key == "passes"
            what = f"{key} must be {format_limit(getattr(limits, key))} at {'most' if most else 'least'}, not {value:g}"
            raise place.fault(
                key,
                what,
                f"give a value that can be meant, or {'raise' if most else 'lower'} limits.{key}",
            )


def _unknown_key(table: str, key: str, origin: str) -> JobError:
    elsewhere = [s.table for s in list_settings() if s.key == key]
    elsewhere.sort(key=lambda home: not table.startswith(home))
    remedy = (
        f"it belongs to [{elsewhere[0]}]" if elsewhere else suggest(str(key), _settings_of(table))
    )
    return JobError(origin, f"unknown key {_quote(key)}", _place(table), remedy)


def _floats(value: object) -> Iterator[float]:
    return (number for number in _numbers(value) if isinstance(number, float))


def _numbers(value: object) -> Iterator[float]:
    if isinstance(value, (float, int)):
        yield value
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, Mapping):
        yield from _numbers(list(value.values()))


def _quote_short(value: object) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 40 else text[:37] + "..."


def _quote(name: object) -> str:
    return f'"{_clean(name)}"'


def _clean(name: object) -> str:
    return str(name)[:60]
