"""The commands and their arguments, as the command line and its help have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class Argument(NamedTuple):
    """An argument of a command.

    names: its name, or the spellings of an option with a space between them.
    metavar: name of its value in the help; "" for an option without a value.
    about: its line of the help.
    settings: other settings, by their names in `argparse`.
    """

    names: str
    metavar: str
    about: str
    settings: Mapping[str, Any] = {}


class Command(NamedTuple):
    """A command: its line of the help, and its arguments."""

    about: str
    arguments: Sequence[Argument]


_REQUIRED: Mapping[str, Any] = {"required": True}
_SEVERAL: Mapping[str, Any] = {"nargs": "+"}
_REPEATED: Mapping[str, Any] = {"action": "append", "default": []}
_NUMBER: Mapping[str, Any] = {"type": float}
_WHOLE: Mapping[str, Any] = {"type": int}


def _make_setting(about: str) -> Argument:
    return Argument("--set", "TABLE.KEY=VALUE", about, {**_REPEATED, "dest": "sets"})


_FORCE = Argument("--force", "", "replace programs that were edited by hand")
_JSON = Argument("--json", "", "print the result as JSON")
_POST = Argument(
    "--post", "NAME", "controller, as listed by camgen posts; or a .py file", _REQUIRED
)
_JOB = (
    Argument(
        "--job", "FILE.toml", "job file (default: part.toml beside the input part.*, if it exists)"
    ),
    _make_setting("setting, overrides the job file; may be repeated"),
)
COMMANDS: Mapping[str, Command] = {
    "build": Command(
        "make a checked program from a drawing, a photo, a 3-D part or old G-code",
        [
            Argument(
                "inputs",
                "INPUT",
                "input file; several drawings make one program; -: standard input",
                _SEVERAL,
            ),
            _POST,
            *_JOB,
            Argument(
                "-o --output",
                "FILE|DIR",
                "file or folder of the program; -: standard output (default: this folder)",
            ),
            Argument("--format", "FORMAT", "format of standard input, e.g. dxf"),
            Argument("--locate", "PHOTO", "put the drawing where this photo shows the part"),
            Argument(
                "--start", "X,Y,TURN", "approximate pose of the part for --locate, mm and deg"
            ),
            Argument("--plan", "FILE.json", "write the planned motion as JSON"),
            Argument("--report", "FILE.json", "write the summary as JSON"),
            Argument(
                "--preview",
                "FILE",
                "draw part, paths and travel: a page (.html) or a picture (.svg, .png)",
            ),
            Argument("--strict", "", "anything left out is an error"),
            _FORCE,
        ],
    ),
    "open": Command(
        "open the workbench: the job as a form in the browser, with its program",
        [
            Argument(
                "inputs", "INPUT", "drawing, photo, 3-D part, G-code, or a job file", _SEVERAL
            ),
            Argument(
                "--post",
                "NAME",
                "controller at the start (default: gcode; rapid for 3-D parts); or a .py file",
            ),
            *_JOB,
            Argument("-o --output", "DIR", "folder for Save (default: this folder)"),
            Argument(
                "--port",
                "N",
                "port on 127.0.0.1 (default: any free port)",
                {"type": int, "default": 0},
            ),
            Argument("--no-browser", "", "print the address, do not open a browser"),
        ],
    ),
    "batch": Command(
        "build many parts, one program each, several at once",
        [
            Argument(
                "inputs", "GLOB", "inputs, as names or patterns, e.g. 'parts/**/*.dxf'", _SEVERAL
            ),
            _POST,
            *_JOB,
            Argument("-o --output", "DIR", "folder of the programs (default: this folder)"),
            Argument(
                "--jobs", "N", "number of parts built at once (default: one per processor)", _WHOLE
            ),
            Argument(
                "--timeout", "S", "maximum time for a part, s; 0: no limit (default: 600)", _NUMBER
            ),
            Argument("--dask", "ADDRESS", "build on a Dask cluster, e.g. tcp://host:8786"),
            Argument("--report", "FILE.json", "write the table as JSON"),
            Argument("--strict", "", "a part fails if anything of it is left out"),
            _FORCE,
        ],
    ),
    "inspect": Command(
        "show the contents of a file, or compare a photo with its drawing",
        [
            Argument("input", "INPUT", "drawing, picture, 3-D part or G-code; -: standard input"),
            *_JOB,
            Argument("--format", "FORMAT", "format of standard input, e.g. dxf"),
            Argument(
                "--against",
                "FILE",
                "compare a photo with this drawing, or with the part of this job",
            ),
            Argument(
                "--least", "MM", "smallest difference to report, mm (default: one pixel)", _NUMBER
            ),
            Argument("--preview", "FILE", "draw the differences (.svg, .png)"),
            Argument(
                "--removal",
                "MM",
                "removal per pass, mm: reports passes and feed for each burr",
                _NUMBER,
            ),
            Argument(
                "--rework",
                "FILE.toml",
                "write a job that removes the burrs, and its drawing FILE.dxf",
            ),
            Argument("--strict", "", "a difference is an error, exit code 4"),
            _JSON,
        ],
    ),
    "init": Command(
        "write a commented job file for an input",
        [
            Argument("input", "INPUT", "input; part.dxf gives the job file part.toml"),
            Argument("--operations", "", "propose tools and operations for the closed contours"),
            Argument(
                "--material",
                "NAME",
                "feeds and speeds of the tools by published charts, e.g. plywood",
            ),
            _make_setting("setting to write into the job file; may be repeated"),
        ],
    ),
    "verify": Command(
        "read a program back, report its motion and check it",
        [
            Argument("programs", "PROGRAM", "files of the program in their order", _SEVERAL),
            Argument(
                "--post", "NAME", "controller (default: recognised from the text); or a .py file"
            ),
            *_JOB,
            Argument("--plan", "PLAN.json", "compare with this plan of build --plan"),
            Argument("--part", "DRAWING", "prove that the program does not cut into this part"),
            Argument(
                "--dialect",
                "NAME",
                "dialect of the language, e.g. fanuc, mach3, grbl, marlin of G-code",
            ),
            Argument(
                "--assume",
                "NAME=VALUE",
                "value of an input or of anything else outside the text, e.g. di1=1; "
                "may be repeated",
                _REPEATED,
            ),
            Argument("--points", "FILE", "file with locations by name; may be repeated", _REPEATED),
            Argument("--entry", "NAME", "routine to run (default: main, or the first)"),
            Argument(
                "--report", "FILE.html", "write a page with the motion, the text and the findings"
            ),
            Argument(
                "--summary", "", "check many programs in files, folders and patterns: one row each"
            ),
            Argument("--sarif", "", "print the rows as SARIF 2.1.0, for a pipeline"),
            _JSON,
        ],
    ),
    "calibrate": Command(
        "measure the lens of a camera from photos of a board",
        [
            Argument(
                "photos", "PHOTO", "photo of the board; eight or more from all sides", _SEVERAL
            ),
            Argument("--board", "COLSxROWS", "inner corners of a chessboard, e.g. 9x6", _REQUIRED),
            Argument("--square", "MM", "width of a square, mm", {**_NUMBER, **_REQUIRED}),
            Argument("-o --output", "FILE.yaml", "camera_info file to write", _REQUIRED),
            Argument(
                "--marker",
                "MM",
                "width of a marker of a ChArUco board, mm; --board is then in squares",
                _NUMBER,
            ),
            Argument(
                "--dictionary", "NAME", "markers of a ChArUco board, e.g. 5X5_100 (default: 4X4_50)"
            ),
            Argument("--preview", "FILE.svg", "draw the residuals"),
        ],
    ),
    "capture": Command(
        "take a picture with a camera, or from a video or a stream",
        [
            Argument(
                "source",
                "SOURCE",
                "number of a camera, e.g. 0; a video file; the address of a stream",
            ),
            Argument("-o --output", "FILE.png", "picture: .png, .tif or .bmp", _REQUIRED),
            *_JOB,
            Argument(
                "--frames",
                "N",
                "number of frames to average (default: 16)",
                {"type": int, "default": 16},
            ),
            Argument(
                "--skip", "N", "number of frames to skip first (default: 10; 0 for a file)", _WHOLE
            ),
            Argument(
                "--timeout",
                "S",
                "maximum time of the capture, s (default: 10)",
                {"type": float, "default": 10.0},
            ),
            Argument("--strict", "", "blur, glare and missing markers are errors"),
        ],
    ),
    "markers": Command(
        "draw a sheet of markers that define the work plane in a photo",
        [
            Argument("-o --output", "FILE", "drawing, .pdf or .svg", _REQUIRED),
            Argument(
                "--size", "SIZE", "paper: A4, A3, A2 or letter (default: A4)", {"default": "A4"}
            ),
            Argument(
                "--marker",
                "MM",
                "width of a marker, mm (default: 20)",
                {"type": float, "default": 20.0},
            ),
        ],
    ),
    "localize": Command(
        "find a CAD part in a point cloud and write its work frame",
        [
            Argument("model", "MODEL", "part: mesh or STEP"),
            Argument(
                "scan", "SCAN", "point cloud: PLY, PCD, PTX, E57, LAS, XYZ, TXT, CSV, STL, OBJ"
            ),
            Argument("-o --output", "FILE.toml", "job file to write", _REQUIRED),
            Argument(
                "--units", "UNIT", "unit of the scan (default: as stated in it, otherwise mm)"
            ),
            Argument("--model-units", "UNIT", "unit of a mesh that states none (default: mm)"),
            Argument("--start", "X,Y,Z,RX,RY,RZ", "approximate pose of the part, mm and deg"),
            Argument(
                "--viewpoint",
                "X,Y,Z",
                "position of the scanner in the frame of the scan, mm; or unknown",
            ),
        ],
    ),
    "place": Command(
        "search the best stand of a 3-D part before an arm, or of two set-ups",
        [
            Argument("input", "INPUT", "part: mesh or STEP"),
            _POST,
            *_JOB,
            Argument("-o --output", "FILE.toml", "job file to write, with its [cell]", _REQUIRED),
            Argument(
                "--height",
                "MM",
                "height of the part above the base, mm (default: searched)",
                _NUMBER,
            ),
        ],
    ),
    "robots": Command(
        "list the built-in robots, or describe one of them or of a URDF",
        [
            Argument(
                "robot",
                "ROBOT",
                "a name from the list, or FILE.urdf, FILE.urdf#LINK",
                {"nargs": "?"},
            ),
            _JSON,
        ],
    ),
    "posts": Command(
        "list the installed posts",
        [_JSON],
    ),
    "schema": Command(
        "print the JSON schema of job files, for editors",
        [
            Argument("--post", "NAME", "with the options of this post (default: any option)"),
        ],
    ),
    "completion": Command(
        "print a script that lets a shell complete camgen's commands",
        [
            Argument("shell", "SHELL", "bash, zsh or fish", {"choices": ("bash", "zsh", "fish")}),
        ],
    ),
}
