"""Makes the JSON schema of job files, with the type, bounds, default and meaning of every key."""

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
    """Make the schema of a job file.

    post: name of the post whose options `[post]` may contain; empty: any option.

    Raises JobError for an unknown post.
    """
    about = list_tables()
    tables: Schema = {}
    for name, kind in get_type_hints(Job).items():
        if name not in ("post", *ROWS):
            tables[name] = _make_table(kind, name) | {"description": about[name]}
    for name, rows in ROWS.items():
        keys: Schema = {}
        for kind in rows:
            keys |= _make_table(kind, name)["properties"]
        for key in NOT_IN_ROWS:
            keys.pop(key, None)
        row = {"type": "object", "properties": keys, "additionalProperties": False}
        tables[name] = {"type": "array", "description": list_row_tables()[name], "items": row}
    tables["post"] = {"type": "object", "description": about["post"]}
    if post:
        tables["post"] = _make_options(find_post(post))
    return {
        "$schema": DRAFT,
        "title": f"camgen job for {post}" if post else "camgen job",
        "description": "Lengths mm, angles deg, speeds mm/s, forces N, times s.",
        "type": "object",
        "properties": tables,
        "additionalProperties": False,
    }


def _make_table(kind: type[Struct], name: str) -> Schema:
    (_,), components = msgspec.json.schema_components([kind], ref_template="{name}")
    keys = _inline(components[kind.__name__]["properties"], components)
    properties = {}
    for key, default in msgspec.to_builtins(kind()).items():
        property_schema = _make_key(keys[key], default)
        properties[key] = _add_unit(property_schema) if has_speed(name, key) else property_schema
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _inline(schema_part: Any, components: Mapping[str, Any]) -> Any:
    if isinstance(schema_part, dict):
        if "$ref" in schema_part:
            return _inline(components[schema_part["$ref"]], components)
        return {name: _inline(value, components) for name, value in schema_part.items()}
    if isinstance(schema_part, list):
        return [_inline(value, components) for value in schema_part]
    return schema_part


def _make_key(field: Mapping[str, Any], default: object) -> Schema:
    """Make the schema of a key without null: TOML has none, so such a key is left out of a file."""
    key = {name: value for name, value in field.items() if name not in ("anyOf", "default")}
    kinds = [kind for kind in field.get("anyOf", ()) if kind.get("type") != "null"]
    if len(kinds) == 1:
        key = kinds[0] | key
    elif kinds:
        key["anyOf"] = kinds
    return key if default is None else key | {"default": default}


def _add_unit(key: Schema) -> Schema:
    """The schema of a number `key`, which may also be a text with a unit."""
    rest: Schema = {name: key.pop(name) for name in ("description", "default") if name in key}
    pattern = rf"^\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*({'|'.join(SPEED_UNITS)})\s*$"
    return {"anyOf": [key, {"type": "string", "pattern": pattern}], **rest}


def read_default(option: dataclasses.Field[Any]) -> object:
    """The default of an option of a post."""
    if option.default_factory is dataclasses.MISSING:
        return option.default
    return option.default_factory()


def _make_options(kind: type[Post]) -> Schema:
    hints = get_type_hints(kind)
    options = [option for option in dataclasses.fields(kind) if option.init]
    (_,), components = msgspec.json.schema_components(
        [defstruct("Options", [(option.name, hints[option.name]) for option in options])],
        # A type of a third-party post may have any value.
        schema_hook=lambda option_type: {"title": option_type.__name__},
        ref_template="{name}",
    )
    keys = components["Options"]["properties"]
    properties = {}
    for option in options:
        properties[option.name] = _make_key(keys[option.name], read_default(option))
        if about := option.metadata.get("help"):
            properties[option.name]["description"] = about
    return {
        "type": "object",
        "description": f"options of {kind.about}",
        "properties": properties,
        "additionalProperties": False,
    }
