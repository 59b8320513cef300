"""The JSON schema of job files: what ``settings`` says of every key, in the words of draft 2020-12."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, get_type_hints

import msgspec
from msgspec import Struct, defstruct

from camgen.model.job import SPEED_UNITS, Job
from camgen.model.job_tables import NOT_IN_ROWS, ROWS, has_speed, list_row_tables, list_tables
from camgen.post import Post
from camgen.post.plugins import find_post

Schema = dict[str, Any]
DRAFT = "https://json-schema.org/draft/2020-12/schema"


def schema(post: str = "") -> Schema:
    """The schema of a job file. post: the controller whose options ``[post]`` may hold; any option when empty.
    JobError where there is no such post.
    """
    about = list_tables()
    kinds = {
        name: kind for name, kind in get_type_hints(Job).items() if name not in ("post", *ROWS)
    }
    found = {
        name: _table(kind, name) | {"description": about[name]} for name, kind in kinds.items()
    }
    for name, rows in ROWS.items():
        keys = {
            key: value
            for kind in rows
            for key, value in _table(kind, name)["properties"].items()
            if key not in NOT_IN_ROWS
        }
        row = {"type": "object", "properties": keys, "additionalProperties": False}
        found[name] = {"type": "array", "description": list_row_tables()[name], "items": row}
    found["post"] = (
        _options(find_post(post)) if post else {"type": "object", "description": about["post"]}
    )
    return {
        "$schema": DRAFT,
        "title": f"camgen job for {post}" if post else "camgen job",
        "description": "Lengths mm, angles deg, speeds mm/s, forces N, times s.",
        "type": "object",
        "properties": found,
        "additionalProperties": False,
    }


def _table(kind: type[Struct], name: str) -> Schema:
    """One table: its keys with type, bounds, default and meaning, and no others."""
    (_,), components = msgspec.json.schema_components([kind], ref_template="{name}")
    defaults = msgspec.to_builtins(kind())
    keys = _inline(components[kind.__name__]["properties"], components)
    return {
        "type": "object",
        "properties": {
            key: _speed(_key(keys[key], value)) if has_speed(name, key) else _key(keys[key], value)
            for key, value in defaults.items()
        },
        "additionalProperties": False,
    }


def _inline(schema_part: Any, components: Mapping[str, Any]) -> Any:
    """A schema with the components that it refers to in their places."""
    if isinstance(schema_part, dict):
        if "$ref" in schema_part:
            return _inline(components[schema_part["$ref"]], components)
        return {name: _inline(value, components) for name, value in schema_part.items()}
    return (
        [_inline(value, components) for value in schema_part]
        if isinstance(schema_part, list)
        else schema_part
    )


def _key(found: Mapping[str, Any], default: object) -> Schema:
    """The schema of a key. TOML has no null: what may be nothing is left out of the file instead."""
    key = {name: value for name, value in found.items() if name not in ("anyOf", "default")}
    kinds = [kind for kind in found.get("anyOf", ()) if kind.get("type") != "null"]
    if len(kinds) == 1:
        key = kinds[0] | key
    elif kinds:
        key["anyOf"] = kinds
    return key if default is None else key | {"default": default}


def _speed(key: Schema) -> Schema:
    """The schema of a speed, which may also be a text with its unit."""
    number = {name: value for name, value in key.items() if name not in ("description", "default")}
    told = {name: value for name, value in key.items() if name in ("description", "default")}
    units = "|".join(SPEED_UNITS)
    return {
        "anyOf": [
            number,
            {"type": "string", "pattern": rf"^\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*({units})\s*$"},
        ],
        **told,
    }


def _options(kind: type[Post]) -> Schema:
    """The options of a post, from the fields of its dataclass."""
    hints = get_type_hints(kind)
    options = [option for option in dataclasses.fields(kind) if option.init]
    fields = [(option.name, hints[option.name]) for option in options]
    (_,), components = msgspec.json.schema_components(
        [defstruct("Options", fields)],
        schema_hook=lambda own: {
            "title": own.__name__
        },  # a type of a post from elsewhere: anything
        ref_template="{name}",
    )
    keys = components["Options"]["properties"]
    found = {}
    for option in options:
        default = (
            option.default
            if option.default_factory is dataclasses.MISSING
            else option.default_factory()
        )
        about = option.metadata.get("help")
        found[option.name] = _key(keys[option.name], default) | (
            {"description": about} if about else {}
        )
    return {
        "type": "object",
        "description": f"options of {kind.about}",
        "properties": found,
        "additionalProperties": False,
    }
