"""The options of a post as a table, from the fields of its class.

docs/make/pages.py puts it into the page of the post.
"""

from __future__ import annotations

import dataclasses
import re
from typing import Literal, get_args, get_origin, get_type_hints

from camgen.model.toml import format_toml
from camgen.post.plugins import find_post

_MARKS = ("<!-- options: made by docs/make/pages.py -->\n", "<!-- end of options -->")


def with_options(text: str, name: str) -> str:
    """The text of a page with the current table of its post `name` between the marks."""
    table = format_options(name)
    pattern = re.compile(f"{re.escape(_MARKS[0])}.*?{re.escape(_MARKS[1])}", re.S)
    page, count = pattern.subn(lambda _: f"{_MARKS[0]}\n{table}\n{_MARKS[1]}", text)
    if count != 1:
        raise ValueError(f"the page of {name} has {count} places for its options")
    return page


def format_options(name: str) -> str:
    """The table of options: option, default and meaning, which begins with the choices if any."""
    post = find_post(name)
    hints = get_type_hints(post)
    rows = ["| option | default | meaning |", "|---|---|---|"]
    for field in dataclasses.fields(post):
        if field.init:
            about = field.metadata["help"].replace("|", "\\|")
            choices = list_choices(hints[field.name])
            meaning = f"{choices}; {about}" if choices else about
            rows.append(f"| `{field.name}` | `{format_toml(_default(field))}` | {meaning} |")
    return "\n".join(rows) + "\n"


def _default(field: dataclasses.Field[object]) -> object:
    return (
        field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
    )


def list_choices(hint: object) -> str:
    """The choices of an option, "" for an option with a type, which its default shows."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return ", ".join(f"`{format_toml(value)}`" for value in inner)
    return list_choices(inner[0]) if origin is list else ""
