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
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from typing import NoReturn

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
    alone = sys.getprofile() is None and sys.gettrace() is None and threading.active_count() == 1
    if alone:
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
            return command(arguments, terminal)
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


def _load_command(name: str, *, own_process: bool) -> Callable[[argparse.Namespace, Terminal], int]:
    # An import makes thousands of objects and no garbage. So nothing is searched for it now, nor
    # later, if the process does nothing else.
    enabled = gc.isenabled()
    gc.disable()
    try:
        command: Callable[[argparse.Namespace, Terminal], int]
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
        command = self.prog.removeprefix("camgen ") or "camgen"
        raise JobError(command, message, remedy=f"see {self.prog} --help")


def _parse(words: list[str]) -> argparse.Namespace | None:
    """The arguments; None after --help and --version, which have printed their text."""
    parser, commands = make_parsers()
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


def make_parsers() -> tuple[argparse.ArgumentParser, dict[str, _Parser]]:
    """The parser of the command line, and those of its commands by name."""
    about = "Checked robot and machine programs from drawings and photos."
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser(
        "camgen", description=about, epilog=_EXAMPLES, formatter_class=raw, allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"camgen {__version__}")
    group = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    commands: dict[str, _Parser] = {}

    def command(name: str, text: str, about: Callable[[_Parser], None]) -> None:
        sub = group.add_parser(
            name, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False
        )
        about(sub)
        loud = sub.add_mutually_exclusive_group()
        loud.add_argument("-q", "--quiet", action="store_true", help="print errors only")
        loud.add_argument(
            "-v", "--verbose", action="count", default=0, help="print more; -vv: with tracebacks"
        )
        commands[name] = sub

    command(
        "build", "make a checked program from a drawing, a photo, a 3-D part or old G-code", _build
    )
    command("open", "open the workbench: the job as a form in the browser, with its program", _open)
    command("batch", "build many parts, one program each, several at once", _batch)
    command("inspect", "show the contents of a file, or compare a photo with its drawing", _inspect)
    command("init", "write a commented job file for an input", _init)
    command("verify", "read a program back, report its motion and check it", _verify)
    command("calibrate", "measure the lens of a camera from photos of a board", _calibrate)
    command("capture", "take a picture with a camera, or from a video or a stream", _capture)
    command("markers", "draw a sheet of markers that define the work plane in a photo", _markers)
    command("localize", "find a CAD part in a point cloud and write its work frame", _localize)
    command("place", "search the best stand of a 3-D part before an arm, or of two set-ups", _place)
    command("robots", "list the built-in robots, or describe one of them or of a URDF", _robots)
    command("posts", "list the installed posts", _json)
    command("schema", "print the JSON schema of job files, for editors", _schema)
    command(
        "completion", "print a script that lets a shell complete camgen's commands", _completion
    )
    return parser, commands


def _build(sub: _Parser) -> None:
    sub.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="input file; several drawings make one program; -: standard input",
    )
    _post(sub)
    _job(sub)
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE|DIR",
        help="file or folder of the program; -: standard output (default: this folder)",
    )
    sub.add_argument("--format", metavar="FORMAT", help="format of standard input, e.g. dxf")
    sub.add_argument(
        "--locate",
        metavar="PHOTO",
        help="put the drawing where this photo shows the part",
    )
    sub.add_argument(
        "--start",
        metavar="X,Y,TURN",
        help="approximate pose of the part for --locate, mm and deg",
    )
    sub.add_argument("--plan", metavar="FILE.json", help="write the planned motion as JSON")
    sub.add_argument("--report", metavar="FILE.json", help="write the summary as JSON")
    sub.add_argument(
        "--preview",
        metavar="FILE",
        help="draw part, paths and travel: a page (.html) or a picture (.svg, .png)",
    )
    sub.add_argument("--strict", action="store_true", help="anything left out is an error")
    _force(sub)


def _force(sub: _Parser) -> None:
    sub.add_argument(
        "--force", action="store_true", help="replace programs that were edited by hand"
    )


def _open(sub: _Parser) -> None:
    sub.add_argument(
        "inputs", metavar="INPUT", nargs="+", help="drawing, photo, 3-D part, G-code, or a job file"
    )
    sub.add_argument(
        "--post",
        metavar="NAME",
        help="controller at the start (default: gcode; rapid for 3-D parts); or a .py file",
    )
    _job(sub)
    sub.add_argument("-o", "--output", metavar="DIR", help="folder for Save (default: this folder)")
    sub.add_argument(
        "--port",
        metavar="N",
        type=int,
        default=0,
        help="port on 127.0.0.1 (default: any free port)",
    )
    sub.add_argument(
        "--no-browser", action="store_true", help="print the address, do not open a browser"
    )


def _batch(sub: _Parser) -> None:
    sub.add_argument(
        "inputs",
        metavar="GLOB",
        nargs="+",
        help="inputs, as names or patterns, e.g. 'parts/**/*.dxf'",
    )
    _post(sub)
    _job(sub)
    sub.add_argument(
        "-o", "--output", metavar="DIR", help="folder of the programs (default: this folder)"
    )
    sub.add_argument(
        "--jobs",
        metavar="N",
        type=int,
        help="number of parts built at once (default: one per processor)",
    )
    sub.add_argument(
        "--timeout",
        metavar="S",
        type=float,
        help="maximum time for a part, s; 0: no limit (default: 600)",
    )
    sub.add_argument(
        "--dask", metavar="ADDRESS", help="build on a Dask cluster, e.g. tcp://host:8786"
    )
    sub.add_argument("--report", metavar="FILE.json", help="write the table as JSON")
    sub.add_argument(
        "--strict", action="store_true", help="a part fails if anything of it is left out"
    )
    _force(sub)


def _inspect(sub: _Parser) -> None:
    sub.add_argument(
        "input", metavar="INPUT", help="drawing, picture, 3-D part or G-code; -: standard input"
    )
    _job(sub)
    sub.add_argument("--format", metavar="FORMAT", help="format of standard input, e.g. dxf")
    sub.add_argument(
        "--against",
        metavar="FILE",
        help="compare a photo with this drawing, or with the part of this job",
    )
    sub.add_argument(
        "--least",
        metavar="MM",
        type=float,
        help="smallest difference to report, mm (default: one pixel)",
    )
    sub.add_argument("--preview", metavar="FILE", help="draw the differences (.svg, .png)")
    sub.add_argument(
        "--removal",
        metavar="MM",
        type=float,
        help="removal per pass, mm: reports passes and feed for each burr",
    )
    sub.add_argument(
        "--rework",
        metavar="FILE.toml",
        help="write a job that removes the burrs, and its drawing FILE.dxf",
    )
    sub.add_argument("--strict", action="store_true", help="a difference is an error, exit code 4")
    _json(sub)


def _robots(sub: _Parser) -> None:
    sub.add_argument(
        "robot",
        metavar="ROBOT",
        nargs="?",
        help="a name from the list, or FILE.urdf, FILE.urdf#LINK",
    )
    _json(sub)


def _schema(sub: _Parser) -> None:
    sub.add_argument(
        "--post", metavar="NAME", help="with the options of this post (default: any option)"
    )


def _completion(sub: _Parser) -> None:
    sub.add_argument(
        "shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish"
    )


def _init(sub: _Parser) -> None:
    sub.add_argument("input", metavar="INPUT", help="input; part.dxf gives the job file part.toml")
    sub.add_argument(
        "--operations",
        action="store_true",
        help="propose tools and operations for the closed contours",
    )
    sub.add_argument(
        "--material",
        metavar="NAME",
        help="feeds and speeds of the tools by published charts, e.g. plywood",
    )
    _set(sub, "setting to write into the job file; may be repeated")


def _verify(sub: _Parser) -> None:
    sub.add_argument(
        "programs", metavar="PROGRAM", nargs="+", help="files of the program in their order"
    )
    sub.add_argument(
        "--post",
        metavar="NAME",
        help="controller (default: recognised from the text); or a .py file",
    )
    _job(sub)
    sub.add_argument("--plan", metavar="PLAN.json", help="compare with this plan of build --plan")
    sub.add_argument(
        "--part", metavar="DRAWING", help="prove that the program does not cut into this part"
    )
    sub.add_argument(
        "--dialect",
        metavar="NAME",
        help="dialect of the language, e.g. fanuc, mach3, grbl, marlin of G-code",
    )
    sub.add_argument(
        "--assume",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="value of an input or of anything else outside the text, e.g. di1=1; may be repeated",
    )
    sub.add_argument(
        "--points",
        metavar="FILE",
        action="append",
        default=[],
        help="file with locations by name; may be repeated",
    )
    sub.add_argument("--entry", metavar="NAME", help="routine to run (default: main, or the first)")
    sub.add_argument(
        "--report",
        metavar="FILE.html",
        help="write a page with the motion, the text and the findings",
    )
    sub.add_argument(
        "--summary",
        action="store_true",
        help="check many programs in files, folders and patterns: one row each",
    )
    sub.add_argument(
        "--sarif", action="store_true", help="print the rows as SARIF 2.1.0, for a pipeline"
    )
    _json(sub)


def _calibrate(sub: _Parser) -> None:
    sub.add_argument(
        "photos",
        metavar="PHOTO",
        nargs="+",
        help="photo of the board; eight or more from all sides",
    )
    sub.add_argument(
        "--board",
        metavar="COLSxROWS",
        required=True,
        help="inner corners of a chessboard, e.g. 9x6",
    )
    sub.add_argument(
        "--square", metavar="MM", type=float, required=True, help="width of a square, mm"
    )
    sub.add_argument(
        "-o", "--output", metavar="FILE.yaml", required=True, help="camera_info file to write"
    )
    sub.add_argument(
        "--marker",
        metavar="MM",
        type=float,
        help="width of a marker of a ChArUco board, mm; --board is then in squares",
    )
    sub.add_argument(
        "--dictionary",
        metavar="NAME",
        help="markers of a ChArUco board, e.g. 5X5_100 (default: 4X4_50)",
    )
    sub.add_argument("--preview", metavar="FILE.svg", help="draw the residuals")


def _capture(sub: _Parser) -> None:
    sub.add_argument(
        "source",
        metavar="SOURCE",
        help="number of a camera, e.g. 0; a video file; the address of a stream",
    )
    sub.add_argument(
        "-o", "--output", metavar="FILE.png", required=True, help="picture: .png, .tif or .bmp"
    )
    _job(sub)
    sub.add_argument(
        "--frames",
        metavar="N",
        type=int,
        default=16,
        help="number of frames to average (default: 16)",
    )
    sub.add_argument(
        "--skip",
        metavar="N",
        type=int,
        help="number of frames to skip first (default: 10; 0 for a file)",
    )
    sub.add_argument(
        "--timeout",
        metavar="S",
        type=float,
        default=10.0,
        help="maximum time of the capture, s (default: 10)",
    )
    sub.add_argument(
        "--strict", action="store_true", help="blur, glare and missing markers are errors"
    )


def _markers(sub: _Parser) -> None:
    sub.add_argument("-o", "--output", metavar="FILE", required=True, help="drawing, .pdf or .svg")
    sub.add_argument(
        "--size", metavar="SIZE", default="A4", help="paper: A4, A3, A2 or letter (default: A4)"
    )
    sub.add_argument(
        "--marker",
        metavar="MM",
        type=float,
        default=20.0,
        help="width of a marker, mm (default: 20)",
    )


def _localize(sub: _Parser) -> None:
    sub.add_argument("model", metavar="MODEL", help="part: mesh or STEP")
    sub.add_argument(
        "scan",
        metavar="SCAN",
        help="point cloud: PLY, PCD, PTX, E57, LAS, XYZ, TXT, CSV, STL, OBJ",
    )
    sub.add_argument("-o", "--output", metavar="FILE.toml", required=True, help="job file to write")
    sub.add_argument(
        "--units",
        metavar="UNIT",
        help="unit of the scan (default: as stated in it, otherwise mm)",
    )
    sub.add_argument(
        "--model-units",
        metavar="UNIT",
        help="unit of a mesh that states none (default: mm)",
    )
    sub.add_argument(
        "--start", metavar="X,Y,Z,RX,RY,RZ", help="approximate pose of the part, mm and deg"
    )
    sub.add_argument(
        "--viewpoint",
        metavar="X,Y,Z",
        help="position of the scanner in the frame of the scan, mm; or unknown",
    )


def _place(sub: _Parser) -> None:
    sub.add_argument("input", metavar="INPUT", help="part: mesh or STEP")
    _post(sub)
    _job(sub)
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE.toml",
        required=True,
        help="job file to write, with its [cell]",
    )
    sub.add_argument(
        "--height",
        metavar="MM",
        type=float,
        help="height of the part above the base, mm (default: searched)",
    )


def _json(sub: _Parser) -> None:
    sub.add_argument("--json", action="store_true", help="print the result as JSON")


def _post(sub: _Parser) -> None:
    sub.add_argument(
        "--post",
        metavar="NAME",
        required=True,
        help="controller, as listed by camgen posts; or a .py file",
    )


def _job(sub: _Parser) -> None:
    sub.add_argument(
        "--job",
        metavar="FILE.toml",
        help="job file (default: part.toml beside the input part.*, if it exists)",
    )
    _set(sub, "setting, overrides the job file; may be repeated")


def _set(sub: _Parser, about: str) -> None:
    sub.add_argument(
        "--set",
        metavar="TABLE.KEY=VALUE",
        action="append",
        default=[],
        dest="sets",
        help=about,
    )
