"""The command line: arguments, error lines and exit codes. What a command does is in its own module, imported late."""

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

from camgen.cli.say import Voice, voice
from camgen.cli.stop import Stopped, exit_code, say_why, signals_as_interrupts
from camgen.model.errors import CamgenError, JobError
from camgen.model.text import suggest
from camgen.model.version import __version__

_EXAMPLES = """examples:
  camgen build part.dxf --post gcode --preview part.html
  camgen build photo.jpg --post pacscript --set image.width_mm=300
  camgen init part.dxf

documents: the folder docs of the source, from docs/first-program.md on; camgen COMMAND --help"""

#: Standard input, output and error are the descriptors below.
_STREAMS = 3


def run() -> NoReturn:
    """The command line as a process of its own, which ends at once: to take down one by one what it has loaded and made
    takes 0.1 s of a small build, 0.5 s of a large one.
    """
    code = main()
    # Who watches tells what was seen behind the last line, and another thread may have something to end.
    alone = sys.getprofile() is None and sys.gettrace() is None and threading.active_count() == 1
    if alone:
        try:
            atexit._run_exitfuncs()  # what libraries and plug-ins have asked for is still done
            sys.stdout.flush()
            sys.stderr.flush()
        except OSError:
            sys.exit(code)  # as Python tells it
        os._exit(code)
    sys.exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code: 0 done, 1 fault in camgen, 2 usage or input, 3 no safe program, 4 the
    text read back differs from the plan, 130 interrupted, 143 terminated.
    """
    _open_streams()
    # Nothing here is linear algebra that threads would help; starting them costs 50 ms of every run.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if argv is None and not sys.warnoptions:
        # What comes of numbers without measure is found and told; numpy's own lines beside it help nobody.
        warnings.simplefilter("ignore", RuntimeWarning)
    words = list(sys.argv[1:] if argv is None else argv)
    says = voice(quiet=False, verbose=0)
    try:
        arguments = _parse(words)
        if arguments is None:
            return 0
        says = voice(arguments.quiet, arguments.verbose)
        # Standard output is for results alone: what a plug-in or a library prints goes where all that is told goes.
        with signals_as_interrupts(last=argv is None), redirect_stdout(sys.stderr):
            return _command(arguments.command)(arguments, says)
    except CamgenError as error:
        says.error(f"error: {error}")
        _trace(says)
        return error.exit_code
    except BrokenPipeError:  # who reads the help has read enough
        return 0
    except Stopped as error:
        says.error(say_why(error))
        return exit_code(error)
    # The last resort: whatever it is, also a plug-in that ends the process, the user gets one line and exit code 1.
    except (Exception, SystemExit) as error:
        says.error(
            f"fault: {type(error).__name__}: {error}; add -vv to the command and report what it prints"
        )
        _trace(says)
        return 1


def _open_streams() -> None:
    """Where a stream was closed before the start (``2>&-``), the next file that is opened would take its place, and
    what a library says to it would land in that file.
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


def _trace(says: Voice) -> None:
    if says.verbose > 1:
        importlib.import_module("traceback").print_exc()


def _command(name: str) -> Callable[[argparse.Namespace, Voice], int]:
    # Loading makes thousands of objects and no garbage: none is looked for meanwhile.
    enabled = gc.isenabled()
    gc.disable()
    try:
        command: Callable[[argparse.Namespace, Voice], int] = importlib.import_module(
            f"camgen.cli.{name}"
        ).run
    finally:
        if enabled:
            gc.enable()
    return command


class _Parser(argparse.ArgumentParser):
    """Wrong usage is an error like any other: one line, exit code 2."""

    def error(self, message: str) -> NoReturn:
        raise JobError(
            self.prog.removeprefix("camgen ") or "camgen", message, remedy=f"see {self.prog} --help"
        )


def _parse(words: list[str]) -> argparse.Namespace | None:
    """The arguments. None after --help and --version, which have said what was asked."""
    parser, commands = parsers()
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
    except SystemExit:  # what is wrong with the words is raised by _Parser
        return None
    if unknown:
        options = commands[arguments.command]._option_string_actions  # argparse has no public list
        near = suggest(unknown[0], options) if unknown[0].startswith("-") else ""
        raise JobError(arguments.command, f"unknown argument {unknown[0]!r}", remedy=near)
    return arguments


def parsers() -> tuple[argparse.ArgumentParser, dict[str, _Parser]]:
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
        loud.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
        loud.add_argument(
            "-v", "--verbose", action="count", default=0, help="say more; -vv: with tracebacks"
        )
        commands[name] = sub

    command(
        "build", "make a checked program from a drawing, a photo, a 3-D part or old G-code", _build
    )
    command(
        "open", "open the workbench: the job as a form in the browser, beside what it makes", _open
    )
    command("batch", "build many parts, each by itself, several at once", _batch)
    command("inspect", "show what is in a file", _inspect)
    command("init", "write a commented job file for an input", _init)
    command("verify", "read a program back and say what it does", _verify)
    command("calibrate", "measure the lens of a camera from photos of a board", _calibrate)
    command("capture", "take a picture with a camera, or from a video or a stream", _capture)
    command(
        "markers", "draw a sheet of markers that shows a photo where the work plane is", _markers
    )
    command("localize", "find a CAD part in a point cloud and write its work frame", _localize)
    command("place", "search how a 3-D part should stand for an arm, in one set-up or two", _place)
    command("robots", "list the robots that camgen knows, or say what a URDF describes", _robots)
    command("posts", "list the posts that are installed", _json)
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
        help="what to build from; several drawings make one program; -: stdin",
    )
    _post(sub)
    _job(sub)
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE|DIR",
        help="where the program goes; -: to standard output (default: this folder)",
    )
    sub.add_argument("--format", metavar="FORMAT", help="what standard input is, e.g. dxf")
    sub.add_argument(
        "--locate",
        metavar="PHOTO",
        help="build the drawing where this photo shows its part",
    )
    sub.add_argument(
        "--start",
        metavar="X,Y,TURN",
        help="of poses that look alike take the one near this, mm and deg",
    )
    sub.add_argument("--plan", metavar="FILE.json", help="write the planned motion as data")
    sub.add_argument("--report", metavar="FILE.json", help="write the summary as data")
    sub.add_argument(
        "--preview",
        metavar="FILE",
        help="part, paths, travel: a page (.html) or a drawing (.svg, .png)",
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
        help="controller to begin with (default: gcode; rapid for 3-D parts); or a .py file",
    )
    _job(sub)
    sub.add_argument(
        "-o", "--output", metavar="DIR", help="where Save writes the program (default: this folder)"
    )
    sub.add_argument(
        "--port",
        metavar="N",
        type=int,
        default=0,
        help="port on 127.0.0.1 (default: any that is free)",
    )
    sub.add_argument("--no-browser", action="store_true", help="print the address only")


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
        "-o", "--output", metavar="DIR", help="where the programs go (default: this folder)"
    )
    sub.add_argument(
        "--jobs",
        metavar="N",
        type=int,
        help="how many parts at once (default: one for each processor)",
    )
    sub.add_argument(
        "--timeout",
        metavar="S",
        type=float,
        help="stop a part after so many seconds; 0: never (default: 600)",
    )
    sub.add_argument(
        "--dask", metavar="ADDRESS", help="build on a Dask cluster, e.g. tcp://host:8786"
    )
    sub.add_argument("--report", metavar="FILE.json", help="write the table as data")
    sub.add_argument(
        "--strict", action="store_true", help="a part fails when anything of it is left out"
    )
    _force(sub)


def _inspect(sub: _Parser) -> None:
    sub.add_argument(
        "input", metavar="INPUT", help="drawing, picture, 3-D part or G-code; -: stdin"
    )
    _job(sub)
    sub.add_argument("--format", metavar="FORMAT", help="what standard input is, e.g. dxf")
    sub.add_argument(
        "--against",
        metavar="FILE",
        help="compare a photo with this drawing, or with what its job makes",
    )
    sub.add_argument(
        "--least",
        metavar="MM",
        type=float,
        help="what differs by less is not told (default: a pixel)",
    )
    sub.add_argument("--preview", metavar="FILE", help="draw what differs (.svg, .png)")
    sub.add_argument(
        "--removal",
        metavar="MM",
        type=float,
        help="what a pass takes off: says passes and feed of each burr",
    )
    sub.add_argument(
        "--rework", metavar="FILE.toml", help="write the rework of burrs, with its drawing FILE.dxf"
    )
    sub.add_argument("--strict", action="store_true", help="what differs is an error, exit code 4")
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
    sub.add_argument("input", metavar="INPUT", help="the job file gets its name with .toml")
    sub.add_argument(
        "--operations",
        action="store_true",
        help="with the tools and operations that the closed contours ask for",
    )
    sub.add_argument(
        "--material",
        metavar="NAME",
        help="feeds and speeds of the proposed tools by published charts, e.g. plywood",
    )
    _set(sub, "one setting to write into the job file; may be repeated")


def _verify(sub: _Parser) -> None:
    sub.add_argument(
        "programs", metavar="PROGRAM", nargs="+", help="program, all its files in order"
    )
    sub.add_argument(
        "--post",
        metavar="NAME",
        help="controller (default: what the program looks like); or a .py file",
    )
    _job(sub)
    sub.add_argument(
        "--plan", metavar="PLAN.json", help="compare with this plan, as build --plan wrote it"
    )
    sub.add_argument(
        "--part", metavar="DRAWING", help="prove that nothing of this part is cut that must stay"
    )
    sub.add_argument(
        "--dialect",
        metavar="NAME",
        help="of the language, e.g. fanuc, mach3, grbl, marlin of G-code",
    )
    sub.add_argument(
        "--assume",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="an input, or what else no text holds, e.g. di1=1; may be repeated",
    )
    sub.add_argument(
        "--points",
        metavar="FILE",
        action="append",
        default=[],
        help="locations by name; may be repeated",
    )
    sub.add_argument(
        "--entry", metavar="NAME", help="the routine that is run (default: main, or the first)"
    )
    sub.add_argument(
        "--report",
        metavar="FILE.html",
        help="write a page with the motion, the text and its faults",
    )
    sub.add_argument(
        "--summary",
        action="store_true",
        help="programs of their own in files, folders and patterns: a row for each",
    )
    sub.add_argument("--sarif", action="store_true", help="the rows as SARIF 2.1.0, for a pipeline")
    _json(sub)


def _calibrate(sub: _Parser) -> None:
    sub.add_argument(
        "photos",
        metavar="PHOTO",
        nargs="+",
        help="photos of the board, eight or more from all sides",
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
        help="ChArUco board: width of a marker; then --board is in squares",
    )
    sub.add_argument(
        "--dictionary",
        metavar="NAME",
        help="ChArUco board: its markers, e.g. 5X5_100 (default: 4X4_50)",
    )
    sub.add_argument("--preview", metavar="FILE.svg", help="draw the residuals")


def _capture(sub: _Parser) -> None:
    sub.add_argument(
        "source",
        metavar="SOURCE",
        help="number of a camera, e.g. 0; a video file; address of a stream",
    )
    sub.add_argument(
        "-o", "--output", metavar="FILE.png", required=True, help="the picture: .png, .tif or .bmp"
    )
    _job(sub)
    sub.add_argument(
        "--frames",
        metavar="N",
        type=int,
        default=16,
        help="the mean of so many frames (default: 16)",
    )
    sub.add_argument(
        "--skip",
        metavar="N",
        type=int,
        help="leave out so many before (default: 10; of a file none)",
    )
    sub.add_argument(
        "--timeout",
        metavar="S",
        type=float,
        default=10.0,
        help="give up after so long (default: 10)",
    )
    sub.add_argument(
        "--strict", action="store_true", help="blur, glare and missing markers are errors"
    )


def _markers(sub: _Parser) -> None:
    sub.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="the drawing, .pdf or .svg"
    )
    sub.add_argument(
        "--size", metavar="SIZE", default="A4", help="A4, A3, A2 or letter (default: A4)"
    )
    sub.add_argument(
        "--marker", metavar="MM", type=float, default=20.0, help="width of a marker (default: 20)"
    )


def _localize(sub: _Parser) -> None:
    sub.add_argument("model", metavar="MODEL", help="the part: mesh or STEP")
    sub.add_argument(
        "scan",
        metavar="SCAN",
        help="the point cloud: PLY, PCD, PTX, E57, LAS, XYZ, TXT, CSV, STL, OBJ",
    )
    sub.add_argument("-o", "--output", metavar="FILE.toml", required=True, help="job file to write")
    sub.add_argument(
        "--units",
        metavar="UNIT",
        help="unit of the scan (default: as the scan says, else mm)",
    )
    sub.add_argument(
        "--model-units",
        metavar="UNIT",
        help="unit of a mesh that states none (default: mm)",
    )
    sub.add_argument(
        "--start", metavar="X,Y,Z,RX,RY,RZ", help="roughly where the part stands, mm and deg"
    )
    sub.add_argument(
        "--viewpoint",
        metavar="X,Y,Z",
        help="where the scanner stood, mm in the scan's frame; or unknown",
    )


def _place(sub: _Parser) -> None:
    sub.add_argument("input", metavar="INPUT", help="the part: mesh or STEP")
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
        help="where it stands above the base (default: searched too)",
    )


def _json(sub: _Parser) -> None:
    sub.add_argument("--json", action="store_true", help="say it as data")


def _post(sub: _Parser) -> None:
    sub.add_argument(
        "--post",
        metavar="NAME",
        required=True,
        help="controller; camgen posts lists them; or a .py file",
    )


def _job(sub: _Parser) -> None:
    sub.add_argument(
        "--job",
        metavar="FILE.toml",
        help="job file (default: the input's name with .toml, if it exists)",
    )
    _set(sub, "one setting; wins over the job file; may be repeated")


def _set(sub: _Parser, about: str) -> None:
    sub.add_argument(
        "--set",
        metavar="TABLE.KEY=VALUE",
        action="append",
        default=[],
        dest="sets",
        help=about,
    )
