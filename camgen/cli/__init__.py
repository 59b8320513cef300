"""The command line: arguments, error lines and exit codes.

Each command is a module of its own, which is imported only when it runs.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import importlib
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stdout
from typing import Any, NoReturn

from camgen.cli.arguments import COMMANDS
from camgen.cli.say import Terminal, make_terminal
from camgen.cli.stop import Stopped, exit_code, format_reason, raise_signals
from camgen.model.errors import CamgenError, JobError
from camgen.model.text import suggest
from camgen.model.version import __version__

_EXAMPLES = """examples:
  camgen build part.dxf --post gcode --preview part.html
  camgen build photo.jpg --post pacscript --set image.width_mm=300
  camgen init part.dxf

documents: the folder docs of the source, from docs/first-program.md on; camgen COMMAND --help"""

#: Number of standard streams, which have the descriptors 0, 1 and 2.
_STREAMS = 3


def run() -> NoReturn:
    """Run the command line as a process, which ends without freeing its objects.

    Freeing them one by one would take 0.1 s of a small build and 0.5 s of a large one.
    """
    code = main()
    # A profiler or a debugger reports after the last line, and another thread may not have ended.
    if sys.getprofile() is None and sys.gettrace() is None and threading.active_count() == 1:
        try:
            atexit._run_exitfuncs()  # Libraries and plug-ins may have registered functions.
            sys.stdout.flush()
            sys.stderr.flush()
        except OSError:
            sys.exit(code)  # Python reports the error.
        os._exit(code)
    sys.exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    0 done, 1 fault in camgen, 2 wrong usage or input, 3 no safe program, 4 the read-back differs
    from the plan, 130 interrupted, 143 terminated.
    """
    _open_streams()
    # No linear algebra here is faster with threads. Starting them takes 50 ms of each run.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if argv is None and not sys.warnoptions:
        # camgen checks for numbers that are out of range and reports them itself.
        warnings.simplefilter("ignore", RuntimeWarning)
    words = list(sys.argv[1:] if argv is None else argv)
    terminal = make_terminal(quiet=False, verbose=0)
    try:
        arguments = _parse(words)
        if arguments is None:
            return 0
        terminal = make_terminal(arguments.quiet, arguments.verbose)
        # Standard output is for results alone. The output of plug-ins and libraries goes to
        # standard error, with the messages.
        with raise_signals(last=argv is None), redirect_stdout(sys.stderr):
            command = _load_command(arguments.command, own_process=argv is None)
            return command(arguments, terminal) or 0
    except CamgenError as error:
        terminal.error(f"error: {error}")
        _trace(terminal)
        return error.exit_code
    except BrokenPipeError:  # The reader of the help has closed the pipe.
        return 0
    except Stopped as error:
        terminal.error(format_reason(error))
        return exit_code(error)
    # Any other exception, also a plug-in that ends the process, becomes one line and exit code 1.
    except (Exception, SystemExit) as error:
        what = f"fault: {type(error).__name__}: {error}"
        terminal.error(f"{what}; add -vv to the command and report what it prints")
        _trace(terminal)
        return 1


def _open_streams() -> None:
    """Open the standard streams that were closed before the start (`2>&-`).

    Otherwise the next file that is opened would take the place of the stream, and the messages of
    libraries would be written into that file.
    """
    if None not in (sys.stdin, sys.stdout, sys.stderr):
        return
    spare = os.open(os.devnull, os.O_RDWR)
    while spare < _STREAMS:
        spare = os.open(os.devnull, os.O_RDWR)
    os.close(spare)
    sys.stdin = sys.stdin or open(os.devnull)  # noqa: SIM115 (for as long as the process runs)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115


def _trace(terminal: Terminal) -> None:
    if terminal.verbose > 1:
        importlib.import_module("traceback").print_exc()


def _load_command(
    name: str, *, own_process: bool
) -> Callable[[argparse.Namespace, Terminal], int | None]:
    """The function of a command. It returns the exit code, or None for 0."""
    # An import makes thousands of objects and no garbage. The collector does not run meanwhile. If
    # the process runs this command alone, it leaves these objects out later as well.
    enabled = gc.isenabled()
    gc.disable()
    try:
        command: Callable[[argparse.Namespace, Terminal], int | None]
        command = importlib.import_module(f"camgen.cli.{name}").run
        if own_process:
            gc.freeze()
    finally:
        if enabled:
            gc.enable()
    return command


class _Parser(argparse.ArgumentParser):
    """A parser that raises wrong usage like any other error: one line, exit code 2."""

    def error(self, message: str) -> NoReturn:
        raise JobError(self.prog.removeprefix("camgen "), message, remedy=f"see {self.prog} --help")


def _parse(words: list[str]) -> argparse.Namespace | None:
    """The arguments; None after --help and --version, which have printed their text."""
    # The parsers of all commands take 4 ms.
    parser, commands = make_parsers(words[:1] if words and words[0] in COMMANDS else COMMANDS)
    if not words:
        parser.print_help()
        return None
    first = next((word for word in words if not word.startswith("-")), None)
    if first is None and not {"-h", "--help", "--version"} & set(words):
        raise JobError(
            "command line", "no command is given", remedy=f"give one of {', '.join(commands)}"
        )
    if first is not None and first not in commands:
        raise JobError("command line", f"no command {first!r}", remedy=suggest(first, commands))
    try:
        arguments, unknown = parser.parse_known_args(words)
    except SystemExit:  # after --help or --version; _Parser raises all errors
        return None
    if unknown:
        options = commands[arguments.command]._option_string_actions  # argparse has no public list
        near = suggest(unknown[0], options) if unknown[0].startswith("-") else ""
        raise JobError(arguments.command, f"unknown argument {unknown[0]!r}", remedy=near)
    return arguments


def make_parsers(
    names: Iterable[str] = COMMANDS,
) -> tuple[argparse.ArgumentParser, dict[str, _Parser]]:
    """The parser of the command line with the commands `names`, and their parsers by name."""
    parser = _Parser(
        "camgen",
        description="Checked robot and machine programs from drawings and photos.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"camgen {__version__}")
    group = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    commands: dict[str, _Parser] = {}
    for name in names:
        about, arguments = COMMANDS[name]
        description = f"{about[0].upper()}{about[1:]}."
        sub = group.add_parser(name, help=about, description=description, allow_abbrev=False)
        for spellings, metavar, text, settings in arguments:
            kind: dict[str, Any] = {"metavar": metavar} if metavar else {"action": "store_true"}
            sub.add_argument(*spellings.split(), help=text, **kind, **settings)
        loud = sub.add_mutually_exclusive_group()
        loud.add_argument("-q", "--quiet", action="store_true", help="print errors only")
        loud.add_argument(
            "-v", "--verbose", action="count", default=0, help="print more; -vv: with tracebacks"
        )
        commands[name] = sub
    return parser, commands
