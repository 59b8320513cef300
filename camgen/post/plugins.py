"""Finding posts and their read-backs: by entry point, built-in or foreign, or in a Python file."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.programs import LANGUAGES, Executed, RunRequest, find_language, run_checked
from camgen.model.cell import Cell, Dynamics
from camgen.model.contract import check_members, check_value
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.plugins import find, find_origin, list_entries, load
from camgen.model.text import suggest
from camgen.post import Post
from camgen.post.contract import CELL, CORRECT_POST, POST, POST_CLASS, name_post

POSTS = "camgen.posts"
#: The entry points of read-backs before a language was one function. They are named, not used.
OLD_READBACKS = "camgen.readbacks"
#: Runs the files of a program, by name in the order written, strictly with the options of `[post]`.
Readback = Callable[[Mapping[str, str], Mapping[str, object]], Executed]
_LISTS = "camgen posts lists them"
_REMEDY = "correct the post, or its options in [post]"


class Installed(Struct, frozen=True):
    """One post as ``camgen posts`` lists it. broken: why it cannot be loaded, empty when it can."""

    name: str
    origin: str
    about: str
    suffix: str
    broken: str


def find_post(name: str) -> type[Post]:
    """Find the post class `name`, or the one in the file `name`, a path that ends in .py.

    Raises JobError if there is no such post.
    """
    if name.endswith(".py"):
        post = _load_only_post(name)
    else:
        loaded = load(find(list_entries(POSTS), name, "post", _LISTS))
        if not (isinstance(loaded, type) and issubclass(loaded, Post)):
            raise JobError(
                f"post {name}", "is not a camgen.post.Post", remedy="repair or remove its package"
            )
        post = loaded
    check_members(f"post {name}", POST_CLASS, post, CORRECT_POST)
    return post


def find_readback(name: str) -> Readback:
    """Find the read-back of the post `name`: a strict run of the language of its controller.

    The language of a post in a Python file is its function `run`. Each result is checked. Raises
    JobError if there is no language.
    """
    if name.endswith(".py"):
        run = getattr(_load_module(name), "run", None)
        if not callable(run):
            raise JobError(
                name,
                "has no function run(files, request), the language that its post writes",
                remedy="docs/writing-a-post.md shows one",
            )
        return partial(read_back, partial(run_checked, f"language {name}", run))
    return partial(read_back, find_language(name).run)


def read_back(
    run: Callable[[Mapping[str, str], RunRequest], Executed],
    files: Mapping[str, str],
    options: Mapping[str, object],
) -> Executed:
    """Run a program that a post wrote with the strict rules of its language.

    run: function of the language.
    files: texts by name, in the order written.
    options: options of `[post]` with which the program was written.
    """
    return run(files, RunRequest(options=options))


def list_installed() -> list[Installed]:
    """List all posts by name; a broken one has its reason."""
    posts = []
    for entry in list_entries(POSTS):
        origin = find_origin(entry)
        try:
            post = find_post(entry.name)
        except JobError as error:
            posts.append(Installed(entry.name, origin, "", "", str(error)))
            continue
        reason = _explain_no_language(entry.name)
        posts.append(Installed(entry.name, origin, post.about, post.suffix, reason))
    return posts


def _list_names(group: str) -> list[str]:
    return [entry.name for entry in list_entries(group)]


def _explain_no_language(name: str) -> str:
    if name in _list_names(LANGUAGES):
        try:
            find_language(name)
        except JobError as error:
            return str(error)
        return ""
    reason = f"has no language (entry point {LANGUAGES})"
    if name in _list_names(OLD_READBACKS):
        reason += f"; {OLD_READBACKS} is not read any more, see docs/writing-a-post.md"
    return reason


@cache
def _read_hints(post: type[Post]) -> dict[str, Any]:
    return get_type_hints(post)


def make_post(post: type[Post], options: Mapping[str, object]) -> Post:
    """Make the post with the options of `[post]`.

    A table, such as `signals`, is added to the default of the post (`fill_tables`).

    Raises JobError for an option that the post does not have, or of another type.
    """
    known = {f.name: f for f in dataclasses.fields(post) if f.init}
    hints = _read_hints(post) if options else {}
    for key, value in options.items():
        where = f"[post] {key}"
        if key not in known:
            raise JobError(where, f"{post.name} has no such option", remedy=suggest(key, known))
        try:
            msgspec.convert(value, hints[key])
        except msgspec.ValidationError as error:
            raise JobError(where, str(error)) from error
    # Checked above, against the post's own annotations.
    instance = post(**fill_tables(post, options))  # type: ignore[arg-type]
    check_members(name_post(instance), POST, instance, _REMEDY)
    return instance


def fill_tables(post: type[Post], options: Mapping[str, object]) -> dict[str, object]:
    """Add to the tables of `options` the entries of the post's defaults that they do not name.

    So a job that adds an output keeps the others. A default is dropped if the table gives its
    value, the output, to another name. The read-back needs the same tables.

    >>> from camgen_posts.rapid import Rapid
    >>> fill_tables(Rapid, {"signals": {"flood": "doFlood"}})["signals"]
    {'process': 'doProcess', 'flood': 'doFlood'}
    >>> fill_tables(Rapid, {"signals": {"dout0": "doProcess"}})["signals"]
    {'dout0': 'doProcess'}
    """
    filled = dict(options)
    for option in dataclasses.fields(post):
        given = options.get(option.name)
        if not isinstance(given, Mapping) or option.default_factory is dataclasses.MISSING:
            continue
        default = option.default_factory()
        if isinstance(default, Mapping):
            taken = {str(value).lower() for value in given.values()}
            kept = {key: value for key, value in default.items() if str(value).lower() not in taken}
            filled[option.name] = kept | dict(given)
    return filled


def _load_module(path: str) -> object:
    file = Path(path)
    if not file.is_file():
        raise JobError(path, "no such file")
    spec = importlib.util.spec_from_file_location(f"camgen_post_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise JobError(path, "is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # in which dataclasses and type hints find their names
    try:
        spec.loader.exec_module(module)
    # As with entry points: a third-party file may fail in any way, and the user gets its reason.
    except Exception as error:
        raise JobError(path, f"cannot be loaded: {type(error).__name__}: {error}") from error
    return module


def _load_only_post(path: str) -> type[Post]:
    module = _load_module(path)
    name = getattr(module, "__name__", "")
    classes = [value for value in vars(module).values() if isinstance(value, type)]
    posts = [each for each in classes if issubclass(each, Post) and each.__module__ == name]
    if len(posts) != 1:
        raise JobError(
            path, f"defines {len(posts)} posts", remedy="a post file defines exactly one"
        )
    return posts[0]


def cell_of(post: Post, job: Job) -> Cell:
    """Return the built-in cell of the post, with the dynamics by options and job."""
    cell = post.cell()
    check_value(name_post(post), CELL, cell, CORRECT_POST)
    return replace(cell, pace=dynamics_of(post, job))


def dynamics_of(post: Post, job: Job) -> Dynamics:
    """Return the dynamics that the post assumes, with the acceleration of the job."""
    acceleration, pace = job.process.acceleration, post.dynamics()
    return replace(pace, acceleration=acceleration) if acceleration else pace


def states_rounding(post: Post) -> bool:
    """Whether a post states how its controller rounds corners."""
    return type(post).dynamics is not Post.dynamics
