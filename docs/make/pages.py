"""The generated parts of the documents: robots, API, options of posts, outputs of commands.

    python -m docs.make.pages        writes the pages that are outdated

tests/docs/test_docs.py fails if a page is outdated. `python -m camgen.cli.init` makes docs/job.md,
docs/make/pictures.py makes the pictures.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE, STDOUT, run

from docs.make.api import api_page
from docs.make.limits import format_limits
from docs.make.messages import messages_page
from docs.make.papers import papers_page
from docs.make.posts import with_options
from docs.make.robots import robots_page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
POSTS = ("gcode", "grbl", "pacscript", "rapid", "vplus")
#: Pages whose ```console blocks are run. A command starts with "$ " and continues with "> ".
CONSOLES = ("first-program.md", "several-operations.md", "../README.md")
_LIMITS = re.compile(r"\| limit \|.*\n(?:\|.*\n)+")
_CONSOLE = re.compile(r"```console\n(.*?)```", re.S)


def with_consoles(text: str) -> str:
    """The page with the current output of its commands.

    The commands run in one temporary folder. It has the fixtures of the repository in it and beside
    it.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "try"
        folder.mkdir()
        for parent in (folder.parent, folder):
            (parent / "fixtures").symlink_to(ROOT / "fixtures")
        return _CONSOLE.sub(lambda match: f"```console\n{_run_commands(match[1], folder)}```", text)


def _run_commands(block: str, folder: Path) -> str:
    commands = re.findall(r"^\$ (.*(?:\n>.*)*)$", block, re.M)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    out = ""
    for command in commands:
        process = run(
            ["/bin/sh", "-c", re.sub(r"^> ?", "", command, flags=re.M)],
            cwd=folder,
            env=os.environ | {"PATH": path, "COLUMNS": "100"},
            stdout=PIPE,
            stderr=STDOUT,
            text=True,
            check=False,
            timeout=600,
        )
        if process.returncode:
            raise RuntimeError(f"{command}\n{process.stdout}")
        out += f"$ {command}\n{process.stdout}"
    return out


def with_limits(text: str) -> str:
    """The page with the table of limits that holds now."""
    return _LIMITS.sub(format_limits(), text)


def _post_page(name: str) -> Callable[[str], str]:
    return lambda text: with_options(text, name)


#: Each page with the function from its text to its current text.
PAGES: dict[str, Callable[[str], str]] = {
    "robots.md": lambda _: robots_page(),
    "api.md": lambda _: api_page(),
    "messages.md": lambda _: messages_page(),
    **{f"posts/{name}.md": _post_page(name) for name in POSTS},
    "reliability.md": with_limits,
    "papers.md": lambda _: papers_page(),
    **dict.fromkeys(CONSOLES, with_consoles),
}


def main() -> None:
    for name, make_page in PAGES.items():
        page = DOCS / name
        old_text = page.read_text(encoding="utf-8") if page.exists() else ""
        new_text = make_page(old_text)
        if new_text != old_text:
            page.write_text(new_text, encoding="utf-8")
            print(f"docs/{name} renewed")


if __name__ == "__main__":
    main()
