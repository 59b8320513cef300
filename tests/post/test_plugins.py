"""Posts and their languages: found by name and by path, and each fault of one is named."""

import importlib
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pytest

from camgen.cli import main
from camgen.lang.programs import LANGUAGES, Finding
from camgen.model import plugins
from camgen.model.errors import JobError
from camgen.pipeline import build
from camgen.pipeline.stages import part
from camgen.post import Post
from camgen.post.plugins import (
    OLD_READBACKS,
    POSTS,
    fill_tables,
    find_post,
    find_readback,
    list_installed,
    make_post,
)

POST = """
from dataclasses import dataclass, field
from typing import ClassVar
from camgen.post import Post

@dataclass
class {name}(Post):
    name: ClassVar[str] = "mini"
    suffix: ClassVar[str] = ".min"
    about: ClassVar[str] = "a post in a file"
    count: int = field(default=2, kw_only=True, metadata={{"help": "a number"}})
    def begin(self, program): return ()
    def end(self, program): return ()
    def movej(self, motion): return ()
    def movel(self, motion): return ()
    def output(self, item): return ()
    def wait(self, item): return ()
    def comment(self, text): return text
"""
RUN = """
from camgen.lang.programs import Executed, Finding, Language

def run(files, ask):
    found = tuple(Finding("refused", 1, text) for text in files.values())
    return Executed((), (), findings=found)
"""
LANGUAGE = RUN + 'MINI = Language("mini", "a language", (".min",), lambda text: False, run)\n'


def write(tmp_path, text, name="mini_post.py"):
    file = tmp_path / name
    file.write_text(text)
    return str(file)


@pytest.mark.parametrize("name", ["gcode", "grbl", "pacscript", "rapid", "vplus"])
def test_the_built_in_posts_are_found_with_their_readbacks(name):
    post = find_post(name)
    assert post.name == name
    assert callable(find_readback(name))
    entry = next(entry for entry in list_installed() if entry.name == name)
    assert (entry.suffix, entry.about, entry.broken) == (post.suffix, post.about, "")


def test_a_post_is_found_by_path(tmp_path):
    path = write(tmp_path, POST.format(name="Mini") + RUN)
    assert find_post(path).name == "mini"
    assert find_readback(path)({"a": "b"}, {}).findings == (Finding("refused", 1, "b"),)


def test_a_post_file_may_postpone_its_annotations(tmp_path):
    """A dataclass looks up its module by name, also the module of a file that is loaded by path."""
    path = write(tmp_path, "from __future__ import annotations\n" + POST.format(name="Mini"))
    assert make_post(find_post(path), {"count": 3}).count == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "defines 0 posts"),
        (POST.format(name="One") + POST.format(name="Two"), "defines 2 posts"),
        ("import no_such_module\n", "cannot be loaded: ModuleNotFoundError"),
        ("def f(:\n", "cannot be loaded: SyntaxError"),
        ("1 / 0\n", "cannot be loaded: ZeroDivisionError"),
    ],
)
def test_a_file_that_is_not_a_post_is_refused_by_name(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(JobError, match=message) as caught:
        find_post(path)
    assert caught.value.file == path
    assert "\n" not in str(caught.value)


def test_a_post_file_without_a_readback_is_refused(tmp_path):
    path = write(tmp_path, POST.format(name="Mini"))
    with pytest.raises(JobError, match=r"has no function run\(files, request\)"):
        find_readback(path)


def test_a_missing_file_is_refused():
    with pytest.raises(JobError, match="no such file"):
        find_post("nowhere/post.py")


@pytest.mark.parametrize("find", [find_post, find_readback])
def test_a_name_that_is_not_installed_is_refused_with_the_nearest_one(find):
    with pytest.raises(JobError, match="is not installed; nearest is rapid"):
        find("rapidd")


def install(tmp_path, monkeypatch, module, languages=("strange=strange_post:MINI",), old=()):
    """Installs a distribution by its metadata in a folder. Returns all installed posts by name."""
    (tmp_path / "strange_post.py").write_text(module)
    info = tmp_path / "strange-3.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 3.1\n")
    lines = [f"[{POSTS}]", "strange=strange_post:Mini"]
    lines += [f"[{LANGUAGES}]", *languages, f"[{OLD_READBACKS}]", *old]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "strange_post", raising=False)
    importlib.invalidate_caches()
    return {entry.name: entry for entry in list_installed()}


def test_a_third_party_post_is_listed_with_its_distribution(tmp_path, monkeypatch):
    installed = install(tmp_path, monkeypatch, POST.format(name="Mini") + LANGUAGE)
    entry = installed["strange"]
    assert (entry.origin, entry.suffix, entry.about, entry.broken) == (
        "strange 3.1",
        ".min",
        "a post in a file",
        "",
    )


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("import no_such_module\n", "No module named 'no_such_module'"),
        ("raise RuntimeError('dongle')\n", "RuntimeError: dongle"),
        ("Mini = 3\n", "is not a camgen.post.Post"),
        ("", "AttributeError"),
        ("import sys; sys.exit(0)\n", "SystemExit: 0"),
        ("import time; time.sleep(60)\n", "TooLong: it takes more than 1 s"),
        ("try:\n    while True: pass\nexcept Exception: pass\n", "TooLong: it takes more than 1 s"),
    ],
)
def test_a_broken_plug_in_is_listed_with_its_reason_and_stops_no_other(
    tmp_path, monkeypatch, module, message
):
    monkeypatch.setattr(plugins, "SECONDS", 1)
    installed = install(tmp_path, monkeypatch, module)
    assert message in installed["strange"].broken
    assert installed["strange"].origin == "strange 3.1"
    assert {"gcode", "rapid"} <= set(installed)


def test_a_plug_in_prints_to_standard_error(tmp_path, monkeypatch, capsys):
    """Scripts read standard output."""
    install(tmp_path, monkeypatch, "print('welcome')\n" + POST.format(name="Mini") + LANGUAGE)
    monkeypatch.delitem(sys.modules, "strange_post", raising=False)
    capsys.readouterr()
    assert main(["posts"]) == 0
    printed = capsys.readouterr()
    assert (printed.out.count("welcome"), printed.err) == (0, "welcome\n")
    assert "strange" in printed.out


@pytest.mark.parametrize("does", ["raise SystemExit(0)", "raise RuntimeError('dongle')"])
def test_an_exception_in_a_post_is_reported_and_no_file_is_written(
    tmp_path, monkeypatch, capsys, does
):
    """The build of a post that raises SystemExit(0) does not end with 0."""
    text = (
        "from camgen_posts.gcode import GCode\nclass Own(GCode):\n"
        f"    def end(self, program): {does}\n"
    )
    path = write(tmp_path, text + "def run(files, ask): return None\n")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    bracket = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    assert main(["build", str(bracket), "--post", path, "-q"]) == 1
    assert does.split("(")[0].removeprefix("raise ") in capsys.readouterr().err
    assert [path for path in sorted(tmp_path.iterdir()) if path.name != "__pycache__"] == before


def test_a_post_without_a_language_is_listed_as_broken(tmp_path, monkeypatch):
    installed = install(tmp_path, monkeypatch, POST.format(name="Mini"), languages=())
    assert installed["strange"].broken == "has no language (entry point camgen.languages)"


def test_a_post_with_the_old_entry_point_is_listed_with_the_one_to_use(tmp_path, monkeypatch):
    module = POST.format(name="Mini") + "def read(files, options): return None\n"
    old = ["strange=strange_post:read"]
    installed = install(tmp_path, monkeypatch, module, languages=(), old=old)
    assert installed["strange"].broken == (
        "has no language (entry point camgen.languages); "
        "camgen.readbacks is not read any more, see docs/writing-a-post.md"
    )


def test_the_post_of_a_broken_language_is_listed_with_its_reason(tmp_path, monkeypatch):
    module = POST.format(name="Mini") + "MINI = 3\n"
    installed = install(tmp_path, monkeypatch, module)
    assert "the entry point is 3, not a Language" in installed["strange"].broken


# Members of a plug-in. Each line becomes a part of the class of a post.


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("wait = Post.wait", "__abstractmethods__ must be defined: wait"),
        ("name = 'a b'", "name is 'a b', not a name of letters, digits and _"),
        ("name = 3", "name is 3, not a name"),
        ("suffix = 'min'", "suffix is 'min', not a file name ending"),
        ("suffix = '/../x'", "suffix is '/../x', not a file name ending"),
        ("about = ''", "about is '', not a line of text"),
        ("newline = 'x'", "newline is 'x', not a line end"),
        ("data_suffixes = '.dat'", "data_suffixes is '.dat', not a tuple"),
        ("data_suffixes = ('dat',)", "data_suffixes has an element that is 'dat'"),
        ("changes_tools = 1", "changes_tools is 1, not True or False"),
        ("passes = 'chords'", "passes is 'chords', not a tuple"),
        ("passes = ('cords',)", "passes has the unknown word 'cords', nearest is chords"),
        (
            "verified_fields = frozenset({'spede'})",
            "has the unknown word 'spede', nearest is speed",
        ),
        ("verified_fields = frozenset({3})", "verified_fields has 3, which is not a word"),
        ("verified_fields = 'speed'", "verified_fields is 'speed', not a set of words"),
    ],
)
def test_a_class_with_a_wrong_member_is_refused(tmp_path, line, message):
    path = write(tmp_path, POST.format(name="Mini") + f"    {line}\n")
    with pytest.raises(JobError) as caught:
        find_post(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"post {path}: ")
    assert str(caught.value).endswith("; correct the post")
    assert caught.value.exit_code == 2


def tolerance(**fields):
    numbers = ", ".join(f"{name}={value}" for name, value in fields.items())
    return f"def tolerance(self): return replace(Post.tolerance(self), {numbers})"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("decimals: int = -2", "decimals is -2, not a whole number from 0 to 9"),
        ("decimals: int = 10", "decimals is 10, not a whole number from 0 to 9"),
        ("decimals: int = 2.5", "decimals is 2.5, not a whole number"),
        ("decimals: int = True", "decimals is True, not a whole number"),
        ("max_lines: int = -1", "max_lines is -1, not a whole number of 0 or more"),
        ("program: str = None", "program is None, not a text"),
        (
            "def list_verified(self): return {'spede'}",
            "list_verified() has the unknown word 'spede'",
        ),
        ("def list_verified(self): return None", "list_verified() is None, not a set of words"),
        ("def list_changed(self): return {'feeds'}", "list_changed() has the unknown word 'feeds'"),
        ("def tolerance(self): return 0.001", "tolerance() is 0.001, not a Tolerance"),
        (tolerance(mm="math.inf"), "tolerance() mm = inf is not finite"),
        (tolerance(mm="math.nan"), "tolerance() mm = nan is not finite"),
        (tolerance(mm=0.0), "tolerance() mm = 0 is not above 0"),
        (tolerance(speed=-1.0), "tolerance() speed = -1 is not above 0"),
        (tolerance(share=-1e-9), "tolerance() share = -1e-09 is not above 0"),
        (tolerance(speed="'x'"), "tolerance() speed = 'x' is not a number"),
        (tolerance(angle=0.1), "tolerance() angle = 0.1 is more than 8.7"),
        (tolerance(joint=0.1), "tolerance() joint = 0.1 is more than 1.7"),
        (tolerance(speed=0.2), "tolerance() speed = 0.2 is more than 0.1"),
        (tolerance(force=0.2), "tolerance() force = 0.2 is more than 0.1"),
        (tolerance(seconds=0.02), "tolerance() seconds = 0.02 is more than 0.01"),
        (tolerance(turn=0.01), "tolerance() turn = 0.01 is more than 0.001"),
        (tolerance(share=0.01), "tolerance() share = 0.01 is more than 0.001"),
        (tolerance(rate=0.01), "tolerance() rate = 0.01 is more than 0.001"),
        ("def dynamics(self): return 5", "dynamics() is 5, not a Dynamics"),
        ("def dynamics(self): return Dynamics(ramp=0.0)", "ramp = 0, which is not above 0"),
        (
            "def dynamics(self): return Dynamics(turning=math.inf)",
            "turning = inf, which is not a fin",
        ),
        (
            "def dynamics(self): return Dynamics(corner='round')",
            "corner that is 'round', not a kind",
        ),
        ("def dynamics(self): return Dynamics(shares=1)", "shares that is 1, not True or False"),
        ("def dynamics(self): return Dynamics(axes=1)", "axes that is 1, not None; cell.machine"),
        ("def dynamics(self): return Dynamics(pause=-1)", "pause = -1, which is not above 0"),
    ],
)
def test_a_post_object_with_a_wrong_member_is_refused(tmp_path, line, message):
    head = (
        "import math\nfrom msgspec.structs import replace\nfrom camgen.model.cell import Dynamics\n"
    )
    path = write(tmp_path, head + POST.format(name="Mini") + f"    {line}\n")
    with pytest.raises(JobError) as caught:
        make_post(find_post(path), {})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("decimals", [-1, 10, 400])
def test_an_option_beyond_the_bounds_of_its_member_is_refused(tmp_path, decimals):
    path = write(tmp_path, POST.format(name="Mini"))
    with pytest.raises(JobError, match=f"decimals is {decimals}, not a whole number from 0 to 9"):
        make_post(find_post(path), {"decimals": decimals})


GCODE = """
from camgen.model.cell import Cell
from camgen.model.pose import translation
from camgen.post import OutputFile
from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import Executed
from camgen.model.program import MoveL
from camgen_posts.gcode import GCode

class Own(GCode):
    {post}

def run(files, ask):
    {run}
"""
PROPER = "return run_gcode(files, ask)"


@pytest.mark.parametrize(
    ("post", "run", "message"),
    [
        ("def prepare(self, *_): return None", PROPER, "prepare() is None, not a Program"),
        ("def render(self, _): return None", PROPER, "render() is None, not a tuple"),
        ("def render(self, _): return ('x',)", PROPER, "element that is 'x', not an OutputFile"),
        (
            "def render(self, _): return (OutputFile('a', b''),)",
            PROPER,
            "text that is b'', not a t",
        ),
        ("def render(self, _): return ()", PROPER, "has no file"),
        (
            "def warn(self, _): return ('careful',)",
            PROPER,
            "warn() has an element that is 'careful'",
        ),
        ("@classmethod\n    def cell(cls): return 'mill'", PROPER, "cell() is 'mill', not a Cell"),
        (
            "@classmethod\n    def cell(cls): return Cell('mill', 1, 2, 3)",
            PROPER,
            "cell() has base_from_work that is 1, not a Pose",
        ),
        ("", "return None", "run() is None, not an Executed"),
        ("", "return Executed(('x',), (1,))", "body that has an element of the type str"),
        ("", "return Executed('x', (1,))", "body that is 'x', not a sequence"),
        ("", "return Executed((), (1,))", "lines that has 1 number for 0 instructions"),
        ("", "return Executed((), (), findings=['x'])", "findings that is ['x'], not a tuple"),
        (
            "",
            "return Executed((), (), findings=('x',))",
            "findings that has an element that is 'x'",
        ),
        ("", "return Executed((), (), (3,))", "frames that has an element that is 3"),
        (
            "",
            "return Executed((MoveL(translation(0, 0, 0), 1.0),), ('one',))",
            "lines that has an element that is not a line number",
        ),
    ],
)
def test_a_wrong_result_ends_a_build(tmp_path, monkeypatch, capsys, post, run, message):
    path = write(tmp_path, GCODE.format(post=post or "pass", run=run))
    bracket = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    monkeypatch.chdir(tmp_path)
    assert main(["build", str(bracket), "--post", path, "-q"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert {file.name for file in tmp_path.iterdir()} <= {"mini_post.py", "__pycache__"}


@dataclass
class Options(Post):
    name: ClassVar[str] = "options"
    count: int = field(default=2, kw_only=True)
    ratio: float = field(default=0.5, kw_only=True)
    numbers: dict[str, int] = field(default_factory=dict, kw_only=True)
    _state: int = field(default=0, init=False)

    begin = end = movej = movel = output = wait = comment = lambda *_: ()


def test_the_options_of_a_post_are_its_fields():
    post = make_post(Options, {"count": 3, "ratio": 1, "numbers": {"a": 1}, "decimals": 4})
    assert (post.count, post.ratio, post.numbers, post.decimals, post.program) == (
        3,
        1,
        {"a": 1},
        4,
        "",
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cuont": 3}, r"\[post\] cuont: options has no such option; nearest is count"),
        ({"_state": 3}, "no such option"),
        ({"count": "3"}, r"\[post\] count: Expected `int`, got `str`"),
        ({"count": 1.5}, "Expected `int`"),
        ({"numbers": {"a": "x"}}, r"\[post\] numbers: Expected `int`, got `str`"),
        ({"decimals": None}, "Expected `int`"),
    ],
)
def test_an_invalid_option_is_refused_by_name(options, message):
    with pytest.raises(JobError, match=message):
        make_post(Options, options)


@pytest.mark.parametrize(
    ("name", "process", "other"),
    [
        ("gcode", "P0", "M8"),
        ("grbl", "M3", "M8"),
        ("pacscript", 24, 30),
        ("rapid", "doProcess", "doFlood"),
        ("vplus", 33, 40),
    ],
)
def test_a_signal_of_the_user_is_added_to_the_default_ones(name, process, other):
    post = find_post(name)
    assert make_post(post, {"signals": {"flood": other}}).signals == {
        "process": process,
        "flood": other,
    }
    assert make_post(post, {"signals": {"process": other}}).signals == {"process": other}
    # Another signal takes the output of the default.
    assert make_post(post, {"signals": {"dout0": process}}).signals == {"dout0": process}
    assert make_post(post, {}).signals == {"process": process}
    assert fill_tables(post, {"signals": 3, "decimals": 4}) == {"signals": 3, "decimals": 4}


@pytest.mark.parametrize(
    ("name", "flood"), [("rapid", "doFlood"), ("pacscript", 30), ("vplus", 40), ("gcode", "M8")]
)
def test_a_build_with_another_unused_signal_prints_the_same_text(name, flood):
    square = part([(0, 0), (40, 0), (40, 30), (0, 30), (0, 0)])
    plain, more = (
        build(square, post=name, job={"post": post}) for post in ({}, {"signals": {"flood": flood}})
    )
    strip = re.compile(r"(?:job|text) [0-9a-f]{12}")
    assert strip.sub("", more.text) == strip.sub("", plain.text)
