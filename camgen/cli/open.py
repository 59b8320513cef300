"""The command `open`: the workbench, a job as a form in the browser beside its program."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from camgen.cli.build import list_rows
from camgen.cli.say import Terminal
from camgen.model.errors import InputError, JobError
from camgen.model.text import counted
from camgen.post.plugins import find_post, list_installed
from camgen.read import find_reader
from camgen.read.files import Files


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Serve the workbench until its pages are closed, or Ctrl-C."""
    try:
        from camgen.workbench.server import CommandLine, open_socket, serve  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise JobError(
            "open",
            f"needs {error.name}",
            remedy="pip install '.[workbench]' in the folder of camgen",
        ) from error
    from camgen.workbench.guard import make_token  # noqa: PLC0415 (asyncio, only for this command)
    from camgen.workbench.session import open_session  # noqa: PLC0415

    inputs, job = _inputs(arguments.inputs, arguments.job)
    folder = Path(arguments.output or "")
    if not folder.is_dir():
        raise JobError(
            str(folder),
            "is not a folder",
            "-o",
            "make it first; programs get the names that build gives",
        )
    post = arguments.post or _choose_post(inputs[0])
    find_post(post)  # Raises for an unknown post before a page is opened.
    posts = [installed.name for installed in list_installed() if not installed.broken]
    if post not in posts:
        posts.append(post)
    session = open_session(inputs, job, arguments.sets, post, folder, posts)
    with open_socket(arguments.port) as door:
        token = make_token()
        address = f"http://127.0.0.1:{door.getsockname()[1]}/{token}/"

        def ready() -> None:
            terminal.rows([("open", f"{address} (Ctrl-C or its Close button ends it)", "plain")])
            if not arguments.no_browser:
                _show(address)

        def warn(line: str) -> None:
            terminal.rows([("journal", line, "look")])

        ending = serve(session, CommandLine(list_rows, warn, ready), token, door)
    terminal.clear()
    if not ending.changes:
        return
    what = f"{counted(ending.changes, 'change is', 'changes are')} not saved"
    if ending.kept is None:
        raise JobError(str(session.job_file), f"{what}, and lost: {ending.fault}")
    raise JobError(
        str(session.job_file), what, f"kept in {ending.kept}", "camgen open offers them again"
    )


def _inputs(names: Sequence[str], job: str | None) -> tuple[list[Path], str | None]:
    """The inputs, and the job file. A job file alone opens the input of its name beside it."""
    paths = list(map(Path, names))
    if len(paths) == 1 and paths[0].suffix.lower() == ".toml":
        if job is not None:
            raise JobError(
                "--job", "a job file is opened already", remedy="name the input, or leave it out"
            )
        return [_find_input(paths[0])], names[0]
    for path in paths:
        find_reader(Files().read(path))  # Raises for an unknown format before a page is opened.
    return paths, job


def _find_input(job: Path) -> Path:
    """The input with the name of a job file. Raises InputError for none, and for several."""
    Files().read(job)
    readable = []
    for path in sorted(job.parent.glob("*")):
        if path.stem == job.stem and path != job and path.is_file():
            try:
                find_reader(Files().read(path))
            except InputError:
                continue
            readable.append(path)
    if len(readable) != 1:
        what = "has no input of its name beside it"
        if readable:
            what = f"fits {', '.join(path.name for path in readable)}"
        raise InputError(str(job), what, remedy=f"camgen open INPUT --job {job}")
    return readable[0]


def _choose_post(path: Path) -> str:
    """The controller at the start: RAPID for parts that need an arm, otherwise G-code."""
    return "rapid" if find_reader(Files().read(path)).makes in ("solid", "curves") else "gcode"


def _show(address: str) -> None:
    import webbrowser  # noqa: PLC0415 (this command only)

    if not webbrowser.open(address):
        sys.stderr.write("no browser was found: open the address above\n")
