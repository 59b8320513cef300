import gc
import importlib.util
import json
import math
import os
import re
import resource
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import camgen.cli.say
import camgen.model.text
from camgen.batch.writing import check_targets, write_all
from camgen.cli import main
from camgen.cli.motion_file import decode, encode
from camgen.model.errors import CamgenError, JobError
from camgen.model.pose import TOOL_DOWN, Pose, rotation_from_fixed_xyz, translation
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.order import search
from camgen.order.solver import speed
from fixtures.program_text import dump

PLATE = (
    "0\nSECTION\n2\nENTITIES\n"
    "0\nCIRCLE\n8\nholes\n10\n50\n20\n25\n40\n10\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n0\n11\n100\n21\n0\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n0\n11\n100\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n50\n11\n0\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n50\n11\n0\n21\n0\n"
    "0\nENDSEC\n0\nEOF\n"
)
POSTS = ["gcode", "grbl", "pacscript", "rapid", "vplus"]
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the commands run. It holds plate.dxf and nothing else."""
    (tmp_path / "plate.dxf").write_text(PLATE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def list_files(folder: Path) -> set[str]:
    """The files in a folder and its folders, relative to it."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def read_error(capsys: Captured) -> str:
    """The message of the error, which must be the only line printed."""
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1, printed.err
    assert printed.err.startswith("camgen: error: ")
    return printed.err.removeprefix("camgen: error: ").rstrip("\n")


# -- build


@pytest.mark.parametrize("post", POSTS)
def test_build_writes_the_program_and_prints_a_summary(
    post: str, folder: Path, capsys: Captured
) -> None:
    assert main(["build", "plate.dxf", "--post", post]) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    (program,) = list_files(folder) - {"plate.dxf"}
    assert Path(program).stem == "plate"
    rows = dict(line.split(maxsplit=1) for line in printed.err.splitlines())
    assert rows["input"].startswith("plate.dxf: ")
    assert "2 contours (2 closed, 0 open), layers holes, outline" in rows["input"]
    # A 6 mm tool outside of the plate and inside of the hole: 300 + 6 pi and 2 pi (10 - 3) mm.
    assert rows["plan"] == "2 paths, work 362.8 mm"
    assert rows["motion"].startswith("verified: 2 contours, ")
    assert rows["stock"] == "not proven: nothing is cut below the top face"
    assert rows["reach"].startswith("not proven: no robot model")
    assert rows["collision"] == "not proven: no robot model"
    assert program in rows["program"]
    equal = r"(verified: )?read back, \d+ instructions equal, largest deviation 0\.00\d+ mm"
    assert re.fullmatch(equal + "(; not in the text: .*)?", rows["text"])
    assert "assumed" in rows
    assert not re.search(r"[\r\x1b]", printed.err)


def test_line_ends_are_those_of_the_controller(folder: Path) -> None:
    for post in POSTS:
        main(["build", "plate.dxf", "--post", post, "-q", "-o", f"{post}.out"])
    from camgen.post.plugins import find_post  # noqa: PLC0415 (numpy comes with it)

    for post in POSTS:
        program = (folder / f"{post}.out").read_bytes()
        program.decode("ascii")
        newline = find_post(post).newline.encode()
        assert program.count(newline) == program.count(b"\n") > 5
        assert program.endswith(newline)


@pytest.mark.usefixtures("folder")
def test_quiet_prints_nothing_and_verbose_prints_times(capsys: Captured) -> None:
    assert main(["build", "plate.dxf", "--post", "gcode", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["build", "plate.dxf", "--post", "gcode", "-v"]) == 0
    assert re.search(
        r"^timing +reading \d+\.\d\d s, .*writing", capsys.readouterr().err, re.MULTILINE
    )


def test_a_build_writes_program_plan_report_and_preview(folder: Path, capsys: Captured) -> None:
    (folder / "out").mkdir()
    words = [
        "build",
        "plate.dxf",
        "--post",
        "rapid",
        "-o",
        "out/part.mod",
        "--plan",
        "out/plan.json",
    ]
    assert main([*words, "--report", "out/r.json", "--preview", "out/p.svg"]) == 0
    assert list_files(folder / "out") == {"part.mod", "plan.json", "r.json", "p.svg"}
    report = json.loads((folder / "out/r.json").read_text())
    assert report["files"] == ["part.mod"]
    assert report["verify"]["status"] == "equal"
    assert report["tour"]["work_mm"] == pytest.approx(362.83, abs=0.01)
    assert (folder / "out/p.svg").read_text().startswith("<svg ")
    capsys.readouterr()
    assert main(["verify", "out/part.mod", "--post", "rapid", "--plan", "out/plan.json"]) == 0
    assert "deviation  0.0" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_the_collector_runs_again_after_a_build() -> None:
    for words in (["plate.dxf"], ["none.dxf"]):
        main(["build", *words, "--post", "gcode", "-q"])
        assert gc.isenabled()


def test_a_second_build_writes_the_same_bytes(folder: Path) -> None:
    for output in ("a", "b"):
        (folder / output).mkdir()
        extra = [
            f"--plan={output}/a.json",
            f"--report={output}/b.json",
            f"--preview={output}/c.svg",
        ]
        assert main(["build", "plate.dxf", "--post", "gcode", "-q", "-o", output, *extra]) == 0
    assert list_files(folder / "a") == list_files(folder / "b")
    for name in list_files(folder / "a"):
        assert (folder / "a" / name).read_bytes() == (folder / "b" / name).read_bytes()


def test_the_job_beside_the_input_is_used_and_named(folder: Path, capsys: Captured) -> None:
    (folder / "plate.toml").write_text("[tool]\ndiameter = 25\n")
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0
    summary = capsys.readouterr().err
    assert re.search(r"^job +plate\.toml$", summary, re.MULTILINE)
    assert re.search(r"^skipped .*c1.*25 mm tool", summary, re.MULTILINE)
    assert main(["build", "plate.dxf", "--post", "gcode", "--set", "tool.diameter=4"]) == 0
    assert "skipped" not in capsys.readouterr().err
    (folder / "other.toml").write_text("[tool]\ndiameter = 4\n")
    assert main(["build", "plate.dxf", "--post", "gcode", "--job", "other.toml"]) == 0
    assert re.search(r"^job +other\.toml$", capsys.readouterr().err, re.MULTILINE)


def test_the_summary_names_a_job_file_that_is_not_used(folder: Path, capsys: Captured) -> None:
    (folder / "second.dxf").write_text(
        PLATE.replace("\n20\n", "\n20\n1").replace("\n21\n", "\n21\n1")
    )
    (folder / "second.toml").write_text("")
    # The sides of the two plates overlap in part.
    settings = ["--set", "operation.kind=trace", "--set", "operation.shared=each"]
    assert main(["build", "plate.dxf", "second.dxf", "--post", "gcode", *settings]) == 0
    summary = capsys.readouterr().err
    assert "second.toml is not used" in summary
    assert re.search(r"^plan +4 paths", summary, re.MULTILINE)


def test_strict_refuses_a_build_that_leaves_a_path_out(folder: Path, capsys: Captured) -> None:
    words = ["build", "plate.dxf", "--post", "gcode", "--set", "tool.diameter=25"]
    assert main([*words, "--strict"]) == 3
    assert re.match(r"plate\.dxf: --strict and 1 left out, first: .*c1", read_error(capsys))
    assert list_files(folder) == {"plate.dxf"}
    assert main(words) == 0


def test_a_drawing_is_read_from_standard_input(folder: Path) -> None:
    words = [sys.executable, "-m", "camgen", "build", "-", "--post", "gcode"]
    process = subprocess.run(
        [*words, "--format", "dxf"], input=PLATE.encode(), capture_output=True, check=False
    )
    assert process.returncode == 0, process.stderr
    assert list_files(folder) == {"plate.dxf", "stdin.ngc"}
    assert b"(part: stdin.dxf)" in (folder / "stdin.ngc").read_bytes()
    for bytes_given, message in ((b"", b"the file is empty"), (b"rubbish", b"")):
        process = subprocess.run(
            [*words, "--format", "dxf"], input=bytes_given, capture_output=True, check=False
        )
        assert process.returncode == 2
        assert process.stderr.startswith(b"camgen: error: -: " + message)
    process = subprocess.run(words, input=b"x", capture_output=True, check=False)
    assert (
        process.stderr
        == b"camgen: error: -: standard input has no suffix; give its format, e.g. --format dxf\n"
    )


# -- refused builds: the exit code and the message by the words after `camgen build`

REFUSED = {
    "none.dxf --post gcode": (2, "none.dxf: no such file"),
    "plat.dxf --post gcode": (2, "plat.dxf: no such file; nearest is plate.dxf"),
    "none/plate.dxf --post gcode": (2, "none/plate.dxf: no such file; its folder does not exist"),
    "folder --post gcode": (2, "folder: is a folder; name the files in it"),
    "plate.dxf/x --post gcode": (2, "plate.dxf/x: cannot be read: Not a directory"),
    "empty.dxf --post gcode": (2, "empty.dxf: the file is empty"),
    "/dev/null --post gcode": (
        2, "/dev/null: is not a regular file; copy it to a file, or use - with --format"),
    "plate.dxf": (
        2, "build: the following arguments are required: --post; see camgen build --help"),
    "plate.dxf --post rapd": (
        2, "post rapd: is not installed; nearest is rapid; camgen posts lists them"),
    "plate.dxf --post none.py": (2, "none.py: no such file"),
    "plate.dxf --post gcode --previw x.svg": (
        2, "build: unknown argument '--previw'; nearest is --preview"),
    "plate.dxf --post gcode --preview x.pdf": (
        2,
        "x.pdf: a preview is a page (HTML) or a drawing (SVG, PNG); "
        "give a name that ends in .html, .svg or .png",
    ),
    "plate.dxf --post gcode --format dxf": (
        2, "--format: is for standard input; leave it out, or give - as the input"),
    "plate.dxf --post gcode --job none.toml": (
        2,
        "none.toml: cannot be read: No such file or directory (--job); "
        "give a file that can be read",
    ),
    "plate.dxf --post gcode --set post.wrk=1": (
        2, "job: gcode has no such option ([post] wrk); nearest is work"),
    "plate.dxf --post gcode -o plate.dxf": (
        2, "plate.dxf: would overwrite plate.dxf, which is read; give another name"),
    "plate.dxf --post gcode -o link.dxf": (
        2, "link.dxf: would overwrite plate.dxf, which is read; give another name"),
    "plate.dxf --post gcode --plan ./plate.dxf": (
        2, "plate.dxf: would overwrite plate.dxf, which is read; give another name"),
    "plate.dxf --post gcode --job a.toml --report a.toml": (
        2, "a.toml: would overwrite a.toml, which is read; give another name"),
    "plate.dxf --post gcode --plan a.json --report a.json": (
        2, "a.json: is named for two outputs; give another name"),
    "plate.dxf --post gcode --plan plate.ngc": (
        2, "plate.ngc: is named for two outputs; give another name"),
    "plate.dxf --post gcode -o none/": (2, "none/: no such folder; make it first"),
    "plate.dxf --post gcode -o none/a.ngc": (
        2, "none/a.ngc: its folder does not exist (none); make the folder first"),
    "plate.dxf --post gcode --plan folder": (2, "folder: is a folder; give a file name"),
    "plate.dxf --post gcode -o /dev/null": (
        2, "/dev/null: is not a regular file; give a file name"),
    "plate.dxf --post gcode -o /proc/a.ngc": (
        2, "/proc/a.ngc: cannot be written: No such file or directory"),
    "plate.dxf plate.dxf --post gcode": (2, "plate.dxf: is given twice; name every input once"),
}  # fmt: skip


@pytest.mark.parametrize("line", REFUSED)
def test_a_refused_build_prints_one_line_and_writes_nothing(
    line: str, folder: Path, capsys: Captured
) -> None:
    (folder / "folder").mkdir()
    (folder / "empty.dxf").touch()
    (folder / "a.toml").touch()
    (folder / "link.dxf").symlink_to("plate.dxf")
    before = {name: (folder / name).read_bytes() for name in list_files(folder)}
    code, message = REFUSED[line]
    assert main(["build", *line.split()]) == code
    assert read_error(capsys) == message
    assert {name: (folder / name).read_bytes() for name in list_files(folder)} == before


def test_the_input_is_never_overwritten_by_its_own_program(folder: Path, capsys: Captured) -> None:
    (folder / "plate.ngc").write_text(PLATE)
    assert main(["build", "plate.ngc", "--post", "gcode"]) == 2
    assert "would overwrite plate.ngc" in read_error(capsys)
    assert (folder / "plate.ngc").read_text() == PLATE


@pytest.mark.parametrize(
    "name",
    ["a plate (2).dxf", "plåte ☃.dxf", "-plate.dxf", "p" * 251 + ".dxf", "PLATE.DXF", "a.b.dxf"],
)
def test_inputs_with_unusual_names_are_built(name: str, folder: Path) -> None:
    (folder / name).write_text(PLATE)
    assert main(["build", "--post", "gcode", "--", name]) == 0
    assert Path(name).stem + ".ngc" in list_files(folder)
    (folder / Path(name).with_suffix(".ngc")).read_bytes().decode("ascii")


@pytest.mark.usefixtures("folder")
def test_a_name_that_is_too_long_is_refused(capsys: Captured) -> None:
    name = "p" * 5000 + ".dxf"
    assert main(["build", name, "--post", "gcode"]) == 2
    assert read_error(capsys) == f"{name}: cannot be read: File name too long"
    assert main(["build", "plate.dxf", "--post", "gcode", "-o", name]) == 2
    assert read_error(capsys) == f"{name}: cannot be written: File name too long"


def test_a_name_that_is_not_utf_8_is_replaced_in_outputs(folder: Path, capsys: Captured) -> None:
    name = os.fsdecode(b"pl\xe4te.dxf")
    (folder / name).write_text(PLATE)
    assert (
        main(
            [
                "build",
                name,
                "--post",
                "gcode",
                "--report",
                "r.json",
                "--preview",
                "p.svg",
                "--plan",
                "p.json",
            ]
        )
        == 0
    )
    assert json.loads((folder / "r.json").read_text())["input"]["source"] == "pl?te.dxf"
    assert json.loads((folder / "p.json").read_text())["name"] == "pl?te"
    assert "pl te.dxf" in capsys.readouterr().err


# -- usage


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["-q"],
            "command line: no command is given; "
            "give one of build, open, batch, inspect, init, verify, calibrate, capture, "
            "markers, localize, place, robots, posts, schema, completion",
        ),
        (["biuld"], "command line: no command 'biuld'; nearest is build"),
        (["posts", "--quite"], "posts: unknown argument '--quite'; nearest is --quiet"),
        (["posts", "x"], "posts: unknown argument 'x'"),
        (
            ["build", "a", "--post"],
            "build: argument --post: expected one argument; see camgen build --help",
        ),
        (
            ["posts", "-q", "-v"],
            "posts: argument -v/--verbose: not allowed with argument -q/--quiet; "
            "see camgen posts --help",
        ),
    ],
)
def test_wrong_words_of_the_command_line_are_refused(
    words: list[str], message: str, capsys: Captured
) -> None:
    assert main(words) == 2
    assert read_error(capsys) == message


def test_help_lists_the_commands(capsys: Captured) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"camgen {camgen.__version__}\n"
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for command in ("build", "inspect", "init", "verify", "posts"):
        assert re.search(rf"^    {command} ", out, re.MULTILINE)
        assert main([command, "--help"]) == 0


def test_camgen_without_words_prints_first_steps(capsys: Captured) -> None:
    assert main([]) == 0
    out = capsys.readouterr().out
    assert out.count("  camgen ") == 3
    assert "docs/first-program.md" in out


@pytest.mark.usefixtures("folder")
def test_a_program_on_standard_output_is_that_of_a_file(capsys: Captured) -> None:
    assert main(["build", "plate.dxf", "--post", "gcode", "-o", "x.ngc", "-q"]) == 0
    capsys.readouterr()
    assert main(["build", "plate.dxf", "--post", "gcode", "-o", "-"]) == 0
    of_file = Path("x.ngc").read_text().replace("(program x)", "(program plate)")
    # The digest of the text covers the name.
    digest = re.compile(" - text [0-9a-f]{12}")
    assert digest.sub("", capsys.readouterr().out) == digest.sub("", of_file)
    assert not Path("plate.ngc").exists()


@pytest.mark.usefixtures("folder")
def test_inspect_posts_robots_and_verify_print_json(capsys: Captured) -> None:
    def read_json(*words: str) -> Any:
        assert main([*words, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert read_json("inspect", "plate.dxf")["facts"]["units"] == "mm"
    assert {post["name"] for post in read_json("posts")} >= {
        "gcode",
        "grbl",
        "pacscript",
        "rapid",
        "vplus",
    }
    assert "IRB 2400" in [robot["name"] for robot in read_json("robots")]
    assert read_json("robots", "IRB 2400")["joints"][0]["limits"] == [-180.0, 180.0]
    assert main(["build", "plate.dxf", "--post", "gcode", "-q"]) == 0
    assert read_json("verify", "plate.ngc", "--post", "gcode")["faults"] == []
    Path("bad.ngc").write_text(Path("plate.ngc").read_text().replace("M2", "M2 G5 X1"))
    assert main(["verify", "bad.ngc", "--post", "gcode", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"][0]["place"].startswith("bad.ngc line ")


RFA1 = str(Path(__file__).parents[2] / "fixtures" / "parts" / "rfa1")


@pytest.mark.parametrize(
    ("words", "heavy"),
    [
        (["--help"], {"numpy", "msgspec", "ezdxf", "difflib", "importlib.metadata"}),
        (
            ["build", f"{RFA1}.stl", "--job", f"{RFA1}.toml", "--post", "rapid", "-q"],
            {"ezdxf", "shapely", "cv2", "numpy.ma"},
        ),
    ],
)
def test_a_command_loads_no_large_library_that_it_does_not_need(
    words: list[str], heavy: set[str], folder: Path
) -> None:
    code = (
        f"import sys\nfrom camgen.cli import main\nmain({words!r})\n"
        f"print(sorted({heavy!r} & set(sys.modules)))"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder
    )
    assert process.stdout.splitlines()[-1] == "[]"


# -- faults, interrupts, pipes


@pytest.mark.usefixtures("folder")
def test_a_fault_is_one_line_and_has_a_traceback_only_with_vv(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raise_fault(*_: object, **__: object) -> None:
        raise ZeroDivisionError("one\ntwo")

    monkeypatch.setattr("camgen.cli.build.build", raise_fault)
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 1
    message = capsys.readouterr().err
    assert message == (
        "camgen: fault: ZeroDivisionError: one two; "
        "add -vv to the command and report what it prints\n"
    )
    assert main(["build", "plate.dxf", "--post", "gcode", "-vv"]) == 1
    assert "Traceback" in capsys.readouterr().err
    assert main(["build", "none.dxf", "--post", "gcode", "-v"]) == 1
    assert "Traceback" not in capsys.readouterr().err


def test_an_interrupt_is_one_line(
    folder: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raise_interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("camgen.cli.build.build", raise_interrupt)
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 130
    assert capsys.readouterr().err == "camgen: interrupted\n"
    assert list_files(folder) == {"plate.dxf"}


def test_a_closed_pipe_is_not_a_fault(folder: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    for words in (["posts"], ["build", "plate.dxf", "--post", "gcode"], ["--help"]):
        process = subprocess.run(
            [sys.executable, "-m", "camgen", *words], stdout=write, stderr=write, check=False
        )
        assert process.returncode == 0
    os.close(write)
    assert "plate.ngc" in list_files(folder)


@pytest.mark.usefixtures("folder")
def test_a_stage_is_shown_on_a_terminal_only(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0
    printed = capsys.readouterr().err
    assert "\r\x1b[2Kreading ..." in printed
    assert "\x1b[32mmotion" in printed
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0
    assert "\x1b[32m" not in capsys.readouterr().err


# -- writing


def test_a_failed_build_keeps_old_files(folder: Path, capsys: Captured) -> None:
    (folder / "plate.ngc").write_text("(camgen old)")
    assert main(["build", "plate.dxf", "--post", "gcode", "--set", "tool.diameter=x"]) == 2
    assert main(["build", "plate.dxf", "--post", "gcode", "--report", "/proc/r.json"]) == 2
    assert "/proc/r.json: cannot be written" in capsys.readouterr().err
    assert list_files(folder) == {"plate.dxf", "plate.ngc"}
    assert (folder / "plate.ngc").read_text() == "(camgen old)"


def test_a_full_disk_keeps_old_files(folder: Path) -> None:
    (folder / "plate.svg").write_text("old")
    (folder / "plate.ngc").write_text("(camgen old program)")

    def limit_file_size() -> None:
        # The program (about 1 kB) fits, the preview does not. Python ignores SIGXFSZ, so that the
        # write raises an error.
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    words = [
        sys.executable,
        "-B",
        "-m",
        "camgen",
        "build",
        "plate.dxf",
        "--post",
        "gcode",
        "--preview",
        "plate.svg",
    ]
    process = subprocess.run(
        words, capture_output=True, text=True, check=False, preexec_fn=limit_file_size
    )
    assert process.returncode == 2
    assert process.stderr == "camgen: error: plate.svg: cannot be written: File too large\n"
    assert list_files(folder) == {"plate.dxf", "plate.svg", "plate.ngc"}
    assert (folder / "plate.svg").read_text() == "old"
    assert (folder / "plate.ngc").read_text() == "(camgen old program)"


@pytest.mark.parametrize("failing_call", [0, 1, 2])
@pytest.mark.parametrize("kind", [KeyboardInterrupt, OSError(28, "No space left on device")])
@pytest.mark.parametrize("after", [False, True])
def test_a_failed_write_keeps_all_old_files_and_leaves_no_new_ones(
    failing_call: int,
    kind: type[BaseException] | BaseException,
    after: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The renaming number `failing_call` raises, before or after the file has its new name."""
    (tmp_path / "old").write_text("old")
    (tmp_path / "older").write_text("older")
    names = ["old", "new", "older"]
    os_replace, calls = os.replace, []

    def replace(source: Path, target: Path) -> None:
        calls.append(target)
        if len(calls) == failing_call + 1:
            if after:
                os_replace(source, target)
            raise kind
        os_replace(source, target)

    monkeypatch.setattr("os.replace", replace)
    with pytest.raises((KeyboardInterrupt, JobError)):
        write_all([(tmp_path / name, b"fresh") for name in names], {})
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"old": "old", "older": "older"}


def test_writing_keeps_permissions_and_follows_links(tmp_path: Path) -> None:
    real, link, fresh = tmp_path / "real", tmp_path / "link", tmp_path / "fresh"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    old_umask = os.umask(0o027)
    try:
        write_all([(link, b"new"), (fresh, b"new")], {})
    finally:
        os.umask(old_umask)
    assert link.is_symlink()
    assert real.read_text() == fresh.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert stat.S_IMODE(fresh.stat().st_mode) == 0o640
    assert len(list(tmp_path.iterdir())) == 3


def test_writing_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(JobError, match="cannot be written: Not a directory"):
        write_all([(tmp_path / "a", b"1"), (tmp_path / "file" / "b", b"2")], {})
    assert {p.name for p in tmp_path.iterdir()} == {"file"}
    with pytest.raises(JobError, match="its folder does not exist"):
        check_targets([tmp_path / "file" / "b"], [])


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_cut_with_the_spindle_at_rest_is_refused(
    post: str, folder: Path, capsys: Captured
) -> None:
    before = list_files(folder)
    assert main(["build", "plate.dxf", "--post", post, "--set", "operation.depth=3"]) == 2
    remedy = (
        'set it to the speed in rpm, or process.switch to "contact" for a laser or a plasma torch'
    )
    assert (
        read_error(capsys)
        == f"job: a cut of 3 mm with the spindle at rest (process.spindle); {remedy}"
    )
    (folder / "deep.toml").write_text("[operation]\ndepth = 3\n")
    assert main(["build", "plate.dxf", "--post", post, "--job", "deep.toml"]) == 2
    assert read_error(capsys).startswith(
        "deep.toml: a cut of 3 mm with the spindle at rest (process.spindle); "
    )
    assert list_files(folder) == before | {"deep.toml"}


# -- the plan file


def test_a_plan_is_read_back_without_rounding() -> None:
    turned = Pose(rotation_from_fixed_xyz(0.1, 0.2, 3.0), (1 / 3, 2e-17, -7.1))
    down = Pose(TOOL_DOWN, (1.1, 2 / 3, 3.0))
    body = (
        Output("process", 0.0),
        Force(0.0),
        Comment('a "b" ü'),
        MoveJ(Joints((0.1, 1 / 3)), 100.0),
        Wait(0.5),
        MoveJ(down, 50.0, 1.0, Joints((1.0, 2.0))),
        MoveL(turned, 20.0, joints=Joints((1 / 7,))),
        MoveL(Pose(TOOL_DOWN, turned.origin), 20.0, turn=math.pi / 3),
        Force(5.0, (1.0, 0.0, 0.0)),
        MoveC(turned, down, 2 / 3, 0.3, 4.0, (0.0, 1.0, 0.0)),
        MoveL(down, 3.0),
        Force(0.0),
        Output("process", 1.0),
        Wait(0.25),
        Output("process", 0.0),
    )
    program = Program("a b", translation(600, 0, 1 / 3), turned, body, ("one", "two"))
    data = encode(program, "rapid", {"x": 1, "y": [1.5, "a"]}, 0.01)
    plan = decode(data)
    assert (plan.post, plan.options, plan.chord) == ("rapid", {"x": 1, "y": [1.5, "a"]}, 0.01)
    assert dump(plan.program) == dump(program)
    assert encode(plan.program, plan.post, plan.options, plan.chord) == data
    move, reorientation = plan.program.body[6:8]
    assert isinstance(reorientation, MoveL)
    assert (move.turn, reorientation.turn) == (0.0, math.pi / 3)
    assert isinstance(move, MoveL)
    assert move.target.origin == turned.origin
    assert (move.target.rotation == turned.rotation).all()
    loaded = json.loads(data)
    assert loaded["format"] == "camgen-plan 2"
    assert [line["do"] for line in loaded["body"]] == [
        type(instruction).__name__.lower() for instruction in body
    ]
    assert ["turn" in line for line in loaded["body"]].count(True) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"turn":1.5',
            '"turn":0',
            "a motion that only turns the tool has no speed of turning (instruction 2)",
        ),
        ('"turn":1.5', '"turn":-1.5', "has no speed of turning (instruction 2)"),
        ('"turn":1.5', '"turn":"fast"', "Expected `float | null`, got `str` - at `$.body[2].turn`"),
    ],
)
def test_a_plan_with_a_reorientation_without_speed_is_refused(
    old: str, new: str, message: str
) -> None:
    pose = Pose(rotation_from_fixed_xyz(0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    body = (
        MoveJ(Joints((0.1,)), 9.0),
        MoveL(pose, 9.0),
        MoveL(Pose(TOOL_DOWN, (1.0, 2.0, 3.0)), 9.0, turn=1.5),
    )
    data = encode(Program("a", pose, pose, body), "rapid", {}, 0.01)
    assert old.encode() in data
    with pytest.raises((CamgenError, ValueError), match=re.escape(message)):
        decode(data.replace(old.encode(), new.encode()))


# -- verify, inspect, init, posts


@pytest.fixture
def built(folder: Path, capsys: Captured) -> Path:
    assert main(["build", "plate.dxf", "--post", "rapid", "--plan", "plan.json"]) == 0
    capsys.readouterr()
    return folder


@pytest.mark.usefixtures("built")
def test_verify_summarises_the_motion(capsys: Captured) -> None:
    assert main(["verify", "plate.mod", "--post", "rapid"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    rows = dict(line.split(maxsplit=1) for line in printed.out.splitlines())
    # The path runs 3 mm outside of the plate, with quarter circles at its corners, and 3 mm inside
    # of the hole.
    assert rows["extents"] == "x -3 to 103, y -3 to 53, z 0 to 20 mm"
    assert rows["output"] == "doProcess: 0, 1"  # in the order of the program: off first
    assert rows["arcs"] == "62.8 mm"  # 6 pi around the corners, 14 pi in the hole
    assert rows["speed"].endswith("to 100 mm/s")


def test_verify_finds_a_changed_number(built: Path, capsys: Captured) -> None:
    text = (built / "plate.mod").read_text()
    changed = text.replace("103.000", "103.002", 1).replace("[103,", "[103.002,", 1)
    assert changed != text
    (built / "plate.mod").write_text(changed)
    assert main(["verify", "plate.mod", "--post", "rapid", "--plan", "plan.json"]) == 4
    assert read_error(capsys).startswith("plate.mod: instruction ")


def test_verify_lists_faults_by_line(built: Path, capsys: Captured) -> None:
    lines = (built / "plate.mod").read_text().splitlines()
    index = next(k for k, line in enumerate(lines) if "MoveL" in line)
    lines[index] = lines[index].replace("MoveL", "MoveQ")
    (built / "plate.mod").write_text("\n".join(lines) + "\n")
    assert main(["verify", "plate.mod", "--post", "rapid", "--plan", "plan.json"]) == 2
    printed = capsys.readouterr()
    assert f"plate.mod line {index + 1}: " in printed.out
    assert re.match(r"camgen: error: plate\.mod: \d+ faults?, first: ", printed.err)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("none.mod --post rapid", "none.mod: cannot be read: No such file or directory"),
        ("empty.mod --post rapid", "empty.mod: is empty; give a program"),
        ("binary.mod --post rapid", "binary.mod: is not a text; give a program"),
        (
            "plate.mod plate.mod --post rapid",
            "plate.mod: another file has this name; the files of a program differ in name",
        ),
        ("plate.mod --post rapid --plan plate.mod", "plate.mod: is not a plan: "),
        (
            "plate.mod --post rapid --plan none.json",
            "none.json: cannot be read: No such file or directory",
        ),
    ],
)
def test_verify_refuses_files_that_are_not_programs(
    line: str, message: str, built: Path, capsys: Captured
) -> None:
    (built / "empty.mod").touch()
    (built / "binary.mod").write_bytes(b"a\0b")
    assert main(["verify", *line.split()]) == 2
    assert read_error(capsys).startswith(message)


@pytest.mark.usefixtures("folder")
def test_inspect_lists_the_contours_with_their_ids(capsys: Captured) -> None:
    assert main(["inspect", "plate.dxf", "-v"]) == 0
    printed = capsys.readouterr().out
    assert "c1: closed, 20 x 20 mm around 50, 25, layer holes\n" in printed
    assert "c2: closed, 100 x 50 mm around 50, 25, layer outline\n" in printed
    assert main(["inspect", "plate.dxf", "-v", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["contours"]
    assert [contour["id"] for contour in listed] == ["c1", "c2"]
    assert main(["build", "plate.dxf", "--post", "gcode", "--set", 'tour.order=["c99"]']) == 2
    assert "camgen inspect -v shows their ids" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_inspect_shows_layers_and_entities(capsys: Captured) -> None:
    assert main(["inspect", "plate.dxf"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for word in ("holes", "outline", "CIRCLE", "LINE"):
        assert word in printed.out
    assert main(["inspect", "plat.dxf"]) == 2
    assert read_error(capsys) == "plat.dxf: no such file; nearest is plate.dxf"


def test_init_writes_a_job_file_once(folder: Path, capsys: Captured) -> None:
    assert main(["init", "plate.dxf"]) == 0
    capsys.readouterr()
    text = (folder / "plate.toml").read_text()
    assert main(["init", "plate.dxf"]) == 2
    assert read_error(capsys) == "plate.toml: exists; rename it, or delete it to get a new one"
    assert main(["build", "plate.dxf", "--post", "gcode", "-q"]) == 0
    first = (folder / "plate.ngc").read_bytes()
    (folder / "plate.toml").unlink()
    assert main(["build", "plate.dxf", "--post", "gcode", "-q"]) == 0
    assert (folder / "plate.ngc").read_bytes() == first
    assert "diameter = 6.0" in text


def test_posts_lists_all_posts_and_the_fault_of_a_broken_plug_in(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    from camgen.post.plugins import Installed, list_installed  # noqa: PLC0415 (numpy comes with it)

    listed = [
        *list_installed(),
        Installed("ours", "our-posts 1.0", "", "", "plug-in ours: no module named x"),
    ]
    monkeypatch.setattr("camgen.cli.posts.list_installed", lambda: listed, raising=False)
    assert main(["posts"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "suffix", "origin", "about"]
    assert [line.split()[0] for line in lines[1:]] == [*POSTS, "ours"]
    assert lines[-1].endswith("our-posts 1.0  broken: plug-in ours: no module named x")


# -- numbers in messages


def test_durations_lengths_and_sizes_have_readable_units() -> None:
    formats = camgen.cli.say
    assert [camgen.model.text.duration(s) for s in (0.44, 9.99, 59.6, 61, 3599.6, 7260)] == [
        "0.4 s", "10.0 s", "1 min 00 s", "1 min 01 s", "1 h 00 min", "2 h 01 min",
    ]  # fmt: skip
    assert [formats.format_length(mm) for mm in (0.04, 9999.94, 12345.6)] == [
        "0.0 mm",
        "9999.9 mm",
        "12.35 m",
    ]
    assert [formats.format_size(n) for n in (1, 9999, 10_000, 12_345_678)] == [
        "1 byte",
        "9 999 bytes",
        "10 kB",
        "12.3 MB",
    ]
    assert formats.join_names(list("abcdefgh")) == "a, b, c, d, e, f and 2 more"


@pytest.mark.parametrize("fast", [False, True])
def test_the_summary_recommends_the_compiled_search_only_where_it_helps(
    fast: bool, folder: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiled search finds a shorter order of 1,300 lines in the same time.

    The hint is missing if it is installed, or if the method or the time of the search is given.
    """
    if fast and importlib.util.find_spec("numba") is None:
        pytest.skip("numba (extra fast) is not installed")
    monkeypatch.setattr(search, "available", lambda: fast)
    monkeypatch.setattr(speed, "available", lambda: fast)
    lines = "".join(f'<path d="M{5 * (k % 40)} {5 * (k // 40)}h2"/>' for k in range(1300))
    sheet = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="300mm" '
        'viewBox="0 0 300 300">'
    )
    (folder / "many.svg").write_text(f"{sheet}{lines}</svg>")
    build = [
        "build",
        "many.svg",
        "--post",
        "grbl",
        "-o",
        "many.nc",
        "--set",
        "operation.kind=trace",
    ]
    for settings, has_hint in (
        ([], not fast),
        (["tour.method=nearest"], False),
        (["tour.seconds=0.001"], False),
    ):
        extra = ["--set", *settings] if settings else []
        assert main([*build, *extra]) == 0
        summary = capsys.readouterr().err
        assert (
            "; the extra fast (pip install '.[fast]' in the folder of camgen) "
            "searches farther in this time" in summary
        ) == has_hint
        assert summary.count("'.[fast]'") == has_hint
        assert ("local search, compiled: " in summary) == (fast and not settings)


@pytest.mark.parametrize(("words", "code"), [(["--version"], 0), (["inspect", "none.dxf"], 2)])
def test_a_process_ends_after_the_exit_functions_of_libraries(words: list[str], code: int) -> None:
    program = (
        "import atexit, sys\nfrom camgen.cli import run\n"
        "atexit.register(print, 'the last word')\nrun()"
    )
    process = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, check=False
    )
    assert process.returncode == code
    assert process.stdout.endswith("the last word\n")
    assert ("camgen 0.1.0" in process.stdout) == (code == 0)
    assert process.stderr.count("\n") == (code != 0)
