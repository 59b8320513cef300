"""The generated parts of the documents, from the code: robots, API, options of the posts, what commands print.

    python -m docs.make.pages        writes what is not current; tests/docs/test_docs.py says when that is

docs/job.md is made by ``python -m camgen.cli.init``, the pictures by docs/make/pictures.py.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE, STDOUT, run

from docs.make.api import api
from docs.make.limits import format_limits
from docs.make.messages import messages_page
from docs.make.papers import papers_page
from docs.make.posts import with_options
from docs.make.robots import robots_page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
POSTS = ("gcode", "grbl", "pacscript", "rapid", "vplus")
#: Pages whose ```console blocks are run: lines behind "$ " are commands, which go on behind "> ".
CONSOLES = ("first-program.md", "several-operations.md", "../README.md")
_LIMITS = re.compile(r"\| limit \|.*\n(?:\|.*\n)+")
_CONSOLE = re.compile(r"```console\n(.*?)```", re.S)


def with_consoles(text: str) -> str:
    """The page with what its commands print now. They run in one scratch folder, which has the
    repository's fixtures in it and beside it.
    """
    with tempfile.TemporaryDirectory() as name:
        here = Path(name) / "try"
        here.mkdir()
        for folder in (here.parent, here):
            (folder / "fixtures").symlink_to(ROOT / "fixtures")
        return _CONSOLE.sub(lambda found: f"```console\n{_ran(found[1], here)}```", text)


def _ran(block: str, here: Path) -> str:
    commands = re.findall(r"^\$ (.*(?:\n>.*)*)$", block, re.M)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    out = ""
    for command in commands:
        done = run(
            ["/bin/sh", "-c", re.sub(r"^> ?", "", command, flags=re.M)],
            cwd=here,
            env=os.environ | {"PATH": path, "COLUMNS": "100"},
            stdout=PIPE,
            stderr=STDOUT,
            text=True,
            check=False,
            timeout=600,
        )
        if done.returncode:
            raise RuntimeError(f"{command}\n{done.stdout}")
        out += f"$ {command}\n{done.stdout}"
    return out


def with_limits(text: str) -> str:
    """The page with the table of limits that holds now."""
    return _LIMITS.sub(format_limits(), text)


def _post_page(name: str) -> Callable[[str], str]:
    return lambda text: with_options(text, name)


#: Each page with the function from its text to its current text.
PAGES: dict[str, Callable[[str], str]] = {
    "robots.md": lambda _: robots_page(),
    "api.md": lambda _: api(),
    "messages.md": lambda _: messages_page(),
    **{f"posts/{name}.md": _post_page(name) for name in POSTS},
    "reliability.md": with_limits,
    "papers.md": lambda _: papers_page(),
    **dict.fromkeys(CONSOLES, with_consoles),
}


def main() -> None:
    for name, current in PAGES.items():
        page = DOCS / name
        old = page.read_text(encoding="utf-8") if page.exists() else ""
        new = current(old)
        if new != old:
            page.write_text(new, encoding="utf-8")
            print(f"docs/{name} renewed")


if __name__ == "__main__":
    main()
