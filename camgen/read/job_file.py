"""Loads a job from a TOML file, options `--set` or mappings, and checks it."""

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

#: Characters of an option `--set` that a message shows.
_LONGEST = 100
#: Characters of a value that a message shows.
_LONGEST_VALUE = 40
#: Characters of a name that a message shows.
_LONGEST_NAME = 60

#: A number and its unit.
_SPEED = re.compile(r"([0-9]{1,12}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})\s*([a-z]+/[a-z]+)")

#: Settings of [process] for the whole program, which a single operation cannot have.
_WHOLE_PROGRAM = ("acceleration", "turn", "max_feed")

#: The tables of a job by name. The rows of `[[operations]]` are `operations.0`, `operations.1` ...
Tree = dict[str, dict[str, object]]
#: Where a setting comes from, for messages, by table and key.
Origins = Mapping[tuple[str, str], str]


def load_job(file: Path | None, sets: Sequence[str] = (), files: Files | None = None) -> Job:
    """The job of a TOML file, or the default one, with settings that override it.

    sets: settings "table.key=value".
    files: files that were read before and are not read again.

    Raises JobError for a wrong job.
    """
    files = files or Files()
    tree: Tree = {}
    origins: dict[tuple[str, str], str] = {}
    if file is not None:
        tree = _check_tables(_read_toml(file, files), str(file))
        _resolve_paths(tree, file.parent)
        for table, keys in tree.items():
            for key in keys:
                origins[table, key] = str(file)
    for text in sets:
        table, key, value = parse_assignment(text)
        if "." in table and table not in tree:
            name = table.partition(".")[0]
            count = len(_list_rows(tree, name))
            raise JobError(
                f"--set {text}",
                f"there is no {table}: the job has {counted(count, 'row')} of [[{name}]]",
                remedy="they are counted from 0",
            )
        tree.setdefault(table, {})[key] = value
        more = "..." if len(text) > _LONGEST else ""
        origins[table, key] = f"--set {text[:_LONGEST]}{more}"
    return _complete(tree, origins, str(file) if file else "job", files)


def _complete(tree: Tree, origins: dict[tuple[str, str], str], source: str, files: Files) -> Job:
    """The job of `tree`, with the settings of `cell.file` and `tool.file` that it does not have.

    The names of the two files are removed from `tree`.
    """
    _fill_cell(tree, origins, files)
    _fill_tools(tree, origins, files)
    return _convert(tree, origins, source)


def _fill_cell(tree: Tree, origins: dict[tuple[str, str], str], files: Files) -> None:
    name = _take_file(tree, "cell", origins)
    if not name:
        return
    cell_tree = _check_tables(_read_toml(Path(name), files, "cell.file"), name)
    for table in cell_tree:
        if table != "cell":
            raise JobError(
                name, f"is the file of a cell, but has [{table}]", remedy="keep only [cell] in it"
            )
    if "file" in cell_tree.get("cell", {}):
        raise JobError(name, "names a file itself", "[cell]", "put all of the cell into one file")
    _resolve_paths(cell_tree, Path(name).parent)
    cell = tree["cell"]
    for key, value in cell_tree.get("cell", {}).items():
        if key not in cell:
            cell[key] = value
            origins["cell", key] = name


def _take_file(tree: Tree, table: str, origins: Origins) -> str:
    """Remove the key `file` from a table and return its value, "" without the key.

    Raises JobError for a value that is not a text.
    """
    name = tree.get(table, {}).pop("file", "")
    if isinstance(name, str):
        return name
    origin = origins.get((table, "file"), "job")
    raise JobError(origin, f"file must be a text, not {_quote_short(name)}", f"[{table}]")


def _fill_tools(tree: Tree, origins: dict[tuple[str, str], str], files: Files) -> None:
    """Merge the tools of the job with those of `tool.file`, by name. Settings of the job win.

    The tools of the library come first, in its order, then those that the job adds. A tool of the
    job keeps its table name, so that messages and `--set` count the rows of the job.
    """
    name = _take_file(tree, "tool", origins)
    if not name:
        return
    library = _read_tools(name, files)
    table_of = {str(keys.get("name")): table for table, keys in _list_rows(tree, "tools")}
    rows: Tree = {}
    for index, tool in enumerate(library):
        table = table_of.get(str(tool["name"]), f"tools.{name}:{index}")
        keys = tree.get(table, {})
        rows[table] = tool | keys
        for key in tool.keys() - keys.keys():
            origins[table, key] = name
    for table, keys in _list_rows(tree, "tools"):
        rows.setdefault(table, keys)
        tree.pop(table)
    tree.update(rows)


def _read_tools(name: str, files: Files) -> list[dict[str, object]]:
    library = _check_tables(_read_toml(Path(name), files, "tool.file"), name)
    for table in library:
        if not table.startswith("tools."):
            raise JobError(
                name,
                f"is a library of tools, but has {_format_table(table)}",
                remedy="keep only [[tools]] in it",
            )
    if not library:
        raise JobError(name, "holds no [[tools]]", "tool.file", "add one, or leave tool.file out")
    _convert(library, {}, name)
    for table, tool in library.items():
        if not tool.get("name"):
            raise JobError(
                name,
                "a tool of a library has no name",
                _format_table(table),
                "name it: jobs find it by its name",
            )
    return list(library.values())


def _resolve_paths(tree: Tree, folder: Path) -> None:
    """Replace names of files in `tree` by their paths. They are relative to the job file.

    folder: folder of the job file.
    """
    for table, key in FILES:
        name = tree.get(table, {}).get(key)
        is_arm = (table, key) == ("cell", "robot")
        if isinstance(name, str) and name and (not is_arm or split_name(name)):
            tree[table][key] = str(folder / name)
    fixtures = tree.get("cell", {}).get("fixtures")
    if isinstance(fixtures, list):
        tree["cell"]["fixtures"] = [
            str(folder / name) if isinstance(name, str) else name for name in fixtures
        ]


def find_job_file(file: str | None, source: Path | None) -> Path | None:
    """The job file: `file`, or else `STEM.toml` next to the input `source`; None without one."""
    if file is not None:
        return Path(file)
    if source is None:
        return None
    try:
        path = source.with_suffix(".toml")
        return path if path.is_file() and path != source else None
    except (OSError, ValueError):  # an impossible file name, which is reported when it is read
        return None


def from_mapping(tables: Mapping[str, object], files: Files | None = None) -> Job:
    """The job of nested mappings, as in a call of `camgen.build`. Raises JobError for a wrong job.

    files: files that were read before and are not read again.
    """
    contents = {name: _convert_numpy(content) for name, content in tables.items()}
    tree = _check_tables(contents, "job")
    return _complete(tree, {}, "job", files or Files())


def _convert_numpy(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _convert_numpy(content) for key, content in value.items()}
    if isinstance(value, (list, tuple)):
        return list(map(_convert_numpy, value))
    return value.tolist() if hasattr(value, "tolist") else value


def _read_toml(file: Path, files: Files, setting: str = "--job") -> dict[str, Any]:
    """The tables of a file. Raises JobError if it cannot be read.

    setting: the setting that names the file.
    """
    try:
        return tomllib.loads(files.open(file).data.decode("utf-8-sig"))
    except OSError as error:
        raise JobError(
            str(file), f"cannot be read: {error.strerror}", setting, "give a file that can be read"
        ) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise JobError(
            str(file), "is not UTF-8 text", f"line {line}", "save it as UTF-8"
        ) from error
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).partition(" (at ")
        raise JobError(
            str(file), f"is not TOML: {what}", place.rstrip(")"), "correct this line"
        ) from error
    except RecursionError as error:
        raise JobError(str(file), "is nested too deeply") from error
    except ValueError as error:  # Python does not read numbers of thousands of digits
        raise JobError(
            str(file), "holds a number of too many digits", remedy="correct it"
        ) from error


def _check_tables(tree: Mapping[str, object], origin: str) -> Tree:
    result: Tree = {}
    for name, content in tree.items():
        if name in ROWS:
            if not isinstance(content, list) or not all(
                isinstance(row, Mapping) for row in content
            ):
                raise JobError(
                    origin,
                    f"{name} must be tables, not {_quote_short(content)}",
                    remedy=f"write [[{name}]]",
                )
            result |= {f"{name}.{index}": dict(row) for index, row in enumerate(content)}
        elif name not in list_tables():
            raise _report_unknown_table(name, origin, content)
        elif not isinstance(content, Mapping):
            raise JobError(
                origin,
                f"{name} must be a table, not {_quote_short(content)}",
                remedy=f"write [{name}]",
            )
        else:
            result[name] = dict(content)
    return result


def _report_unknown_table(name: str, origin: str, content: object) -> JobError:
    homes = [setting.table for setting in list_settings() if setting.key == name]
    if homes and not isinstance(content, Mapping):
        return JobError(
            origin,
            f'"{_shorten(name)}" is outside of its table',
            remedy=f"it belongs to [{homes[0]}]",
        )
    known = [f"[{table}]" for table in list_tables()] + [f"[[{table}]]" for table in ROWS]
    return JobError(origin, f"unknown table [{_shorten(name)}]", remedy=suggest(str(name), known))


def parse_assignment(text: str) -> tuple[str, str, object]:
    """Table, key and value of a setting "table.key=value".

    The table of a row is `operations.0`. Raises JobError for a text of another form, and for an
    unknown table.
    """
    name, equals, raw = text.partition("=")
    table, dot, key = map(str.strip, name.partition("."))
    origin = f"--set {text}"
    if table in ROWS:
        row, dot, key = map(str.strip, key.partition("."))
        table = f"{table}.{row}"
    if not (equals and dot and table and key):
        names = [f"{setting.table}.{setting.key}" for setting in list_settings()]
        homes = [name for name in names if name.endswith(f".{table}")]
        remedy = suggest(name, homes or names) if name else "write tool.diameter=5"
        raise JobError(origin, "is not table.key=value", remedy=remedy)
    if table not in list_tables() and table.partition(".")[0] not in ROWS:
        raise _report_unknown_table(table, origin, {})
    return table, key, parse_value(raw)


def parse_value(raw: str) -> object:
    """The TOML value that a user has typed, or the text itself if it is not TOML."""
    try:
        parsed = tomllib.loads(f"value = {raw}")
    except (ValueError, RecursionError):  # not TOML, or a number of too many digits
        return raw
    return parsed["value"] if len(parsed) == 1 else raw


def _convert(tree: Tree, origins: Origins, source: str) -> Job:
    """The job of `tree`. Raises JobError for a wrong setting.

    Speeds in `tree` are replaced by numbers, and defaults are added to it.

    source: origin of the settings that are not in `origins`.
    """
    for table, keys in tree.items():
        _check_keys(keys, _Place(table, origins, source))
    limits = _convert_table(Limits, tree.get("limits", {}), _Place("limits", origins, source))
    _check_numbers(tree, origins, source, limits.number)
    for (table, key), value in defaults_beside(tree).items():
        tree[table] = {key: value} | tree.get(table, {})
    values = {
        name: _convert_table(kind, tree.get(name, {}), _Place(name, origins, source))
        for name, kind in get_type_hints(Job).items()
        if name not in ("post", "operation", *ROWS)
    }
    place = _Place("operation", origins, source)
    operation = _convert_operation(tree.get("operation", {}), place)
    job = Job(**values, operation=operation, post=tree.get("post", {}))
    _check_limits(job, place)
    tools = _convert_tools(tree, origins, source)
    steps = [
        _convert_step(tree, job, tools, keys, _Place(table, origins, source))
        for table, keys in _list_rows(tree, "operations")
    ]
    return replace(job, tools=tools, operations=steps)


class _Place(Struct, frozen=True):
    """A table of a job, for messages.

    table: its name.
    origins: origins of the settings.
    source: origin of the settings that are not in `origins`.
    """

    table: str
    origins: Origins
    source: str

    def make_job_error(self, key: str, what: str, remedy: str = "") -> JobError:
        return JobError(self.find_origin(key), what, _format_table(self.table), remedy)

    def find_origin(self, key: str) -> str:
        return self.origins.get((self.table, key), self.source)


def _check_keys(keys: dict[str, object], place: _Place) -> None:
    """Raises JobError for an unknown key and an infinite number. Texts of speeds become numbers."""
    known = list_keys(place.table) if place.table != "post" else keys
    for key, value in keys.items():
        if key not in known:
            raise _report_unknown_key(key, place)
        if isinstance(value, str) and has_speed(place.table.partition(".")[0], key):
            keys[key] = _convert_to_mm_s(value, key, place)
        for number in _list_numbers(keys[key]):
            if isinstance(number, float) and not math.isfinite(number):
                raise place.make_job_error(key, f"{key} must be finite, not {_quote_short(value)}")


def _format_table(table: str) -> str:
    """A table as in a job file. A row has its number from 0, as in `--set`."""
    name, dot, row = table.partition(".")
    return f"[[{name}]] {row.rpartition(':')[2]}" if dot else f"[{name}]"


def _find_settings(table: str) -> dict[str, Setting]:
    name, dot, _ = table.partition(".")
    known = list_row_settings() if dot else list_settings()
    return {setting.key: setting for setting in known if setting.table == name}


Kind = TypeVar("Kind", bound=Struct)


def _convert_table(kind: type[Kind], keys: Mapping[str, object], place: _Place) -> Kind:
    """The value of a table. Raises JobError for a setting of a wrong type or out of range."""
    try:
        return msgspec.convert(keys, kind)
    except msgspec.ValidationError as error:
        match = re.search(r"`\$\.(\w+)", str(error))
        if match is None:
            raise JobError(place.source, str(error)) from error
        key = match.group(1)
        allowed, value = _find_settings(place.table)[key].allowed, keys[key]
        needs_list = allowed.startswith("a list of") and isinstance(value, (str, int, float))
        remedy = f"write [{_quote_short(value)}]" if needs_list else ""
        raise place.make_job_error(
            key, f"{key} must be {allowed}, not {_quote_short(value)}", remedy
        ) from error


def _convert_to_mm_s(value: str, key: str, place: _Place) -> float:
    match = _SPEED.fullmatch(value.strip())
    if match is None or match[2] not in SPEED_UNITS:
        raise place.make_job_error(
            key,
            f"{key} must be a number in mm/s or a text with its unit, not {_quote_short(value)}",
            f'write "1200 mm/min"; units: {", ".join(SPEED_UNITS)}',
        )
    return float(match[1]) * SPEED_UNITS[match[2]]


def _convert_operation(keys: Mapping[str, object], place: _Place) -> OperationTable:
    """The table of an operation. Its `kind` may be an operation of another package."""
    kind = keys.get("kind")
    known = get_args(get_args(get_type_hints(OperationTable, include_extras=True)["kind"])[0])
    # `kind` may have any type here, also one that cannot be hashed.
    if kind in known or kind not in [entry.name for entry in list_entries(OPERATIONS)]:
        return _convert_table(OperationTable, keys, place)
    return replace(_convert_table(OperationTable, {**keys, "kind": "auto"}, place), kind=kind)


def _convert_tools(tree: Tree, origins: Origins, source: str) -> list[ToolRow]:
    """The tools of a job. Raises JobError for two tools with one name or number.

    Names and numbers of a library are distinct, so the error is about a row of the job.
    """
    rows = []
    for table, keys in _list_rows(tree, "tools"):
        place = _Place(table, origins, source)
        rows.append((place, _convert_table(ToolRow, keys, place)))
    used: set[tuple[str, object]] = set()
    # Rows of the library come first. Their tables are not numbered.
    for place, tool in sorted(rows, key=lambda row: row[0].table.partition(".")[2].isdigit()):
        for key, value in (("name", tool.name), ("number", tool.number)):
            if value and (key, value) in used:
                raise place.make_job_error(
                    key,
                    f"{key} {_quote_short(value)} is also that of another tool",
                    "give each its own",
                )
            used.add((key, value))
    return [tool for _, tool in rows]


def _list_rows(tree: Tree, name: str) -> list[tuple[str, dict[str, object]]]:
    return [(table, keys) for table, keys in tree.items() if table.startswith(f"{name}.")]


def _convert_step(
    tree: Tree, job: Job, tools: list[ToolRow], keys: dict[str, object], place: _Place
) -> Step:
    """The step of a row of `[[operations]]`.

    Settings that the row does not have are those of its tool, of [operation] and of [process].
    """
    choice = _convert_table(Choice, _select_keys(keys, Choice), place)
    for name in choice.colors:
        if not resolve_named(name):
            raise place.make_job_error(
                "colors",
                f"there is no color {_quote_short(name)}",
                f'one of {", ".join(BASIC)}, a number of DXF from 1 to 255, or "#rrggbb"',
            )
    tool = job.tool
    tool_values: dict[str, object] = {}
    if choice.tool or tools:
        row = _find_tool(choice, tools, place)
        values = {"feed": row.feed, "plunge": row.plunge, "spindle": row.speed}
        tool_values = {key: value for key, value in values.items() if value is not None}
        tool = ToolTable(**{name: getattr(row, name) for name in ToolTable.__struct_fields__})
    for key in _WHOLE_PROGRAM:
        if key in keys:
            raise place.make_job_error(
                key, f"{key} holds for the whole program", "set it in [process]"
            )
    operation = _convert_operation(
        tree.get("operation", {}) | _select_keys(keys, OperationTable), place
    )
    process_keys = tree.get("process", {}) | tool_values | _select_keys(keys, ProcessTable)
    process = _convert_table(ProcessTable, process_keys, place)
    _check_limits(replace(job, operation=operation), place)
    if operation.kind == "auto":
        # The sides of a contour follow from the contours of other operations, by their kinds.
        on_page = bool(job.page.size) and operation.planner != "image"
        operation = replace(operation, kind="trace" if on_page else "follow")
    return Step(tool, operation, process, choice)


def _find_tool(choice: Choice, tools: list[ToolRow], place: _Place) -> ToolRow:
    what = "names no tool"
    if choice.tool:
        for tool in tools:
            if choice.tool in (tool.name, tool.number):
                return tool
        what = f"there is no tool {_quote_short(choice.tool)}"
    names = ", ".join(str(tool.name or tool.number) for tool in tools)
    raise place.make_job_error("tool", what, f"one of {names}" if tools else "write [[tools]]")


def _select_keys(keys: Mapping[str, object], kind: type[Struct]) -> dict[str, object]:
    return {key: value for key, value in keys.items() if key in kind.__struct_fields__}


def _check_numbers(tree: Tree, origins: Origins, source: str, limit: float) -> None:
    """Raises JobError for a number beyond `limit`, except in options of posts, limits and seeds."""
    for table, keys in tree.items():
        if table in ("post", "limits"):
            continue
        for key, value in keys.items():
            if key != "seed" and any(abs(number) > limit for number in _list_numbers(value)):
                raise JobError(
                    origins.get((table, key), source),
                    f"{key} cannot be beyond {format_limit(limit)}: {_quote_short(value)}",
                    _format_table(table),
                    "give a smaller value, or raise limits.number",
                )


def _check_limits(job: Job, place: _Place) -> None:
    """Raises JobError for a setting that is beyond a limit of the same job."""
    for table_place, key, value, side, change in (
        (place, "passes", job.operation.passes, "most", "raise"),
        (place, "stepover", job.operation.stepover, "least", "lower"),
        (replace(place, table="tolerance"), "chord", job.tolerance.chord, "least", "lower"),
    ):
        limit = getattr(job.limits, key)
        is_beyond = value > limit if side == "most" else value < limit
        if is_beyond:
            raise table_place.make_job_error(
                key,
                f"{key} must be {format_limit(limit)} at {side}, not {value:g}",
                f"give a value within it, or {change} limits.{key}",
            )


def _report_unknown_key(key: str, place: _Place) -> JobError:
    homes = [setting.table for setting in list_settings() if setting.key == key]
    homes.sort(key=lambda home: not place.table.startswith(home))
    remedy = suggest(str(key), _find_settings(place.table))
    if homes:
        remedy = f"it belongs to [{homes[0]}]"
    return JobError(
        place.find_origin(key), f'unknown key "{_shorten(key)}"', _format_table(place.table), remedy
    )


def _list_numbers(value: object) -> Iterator[float]:
    if isinstance(value, (float, int)):
        yield value
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _list_numbers(item)
    elif isinstance(value, Mapping):
        yield from _list_numbers(list(value.values()))


def _quote_short(value: object) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def _shorten(name: object) -> str:
    return str(name)[:_LONGEST_NAME]
