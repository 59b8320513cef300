"""The job of the workbench: its form, its file, and that a program from it is the one of the command line."""

import shutil
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from camgen.cli import main
from camgen.cli.build import list_rows
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.job_tables import list_row_settings, list_settings
from camgen.pipeline import build
from camgen.plan import ignore_stages
from camgen.read.files import Files
from camgen.read.job_file import from_mapping
from camgen.workbench.choose import leave_out, restore, switch_layer
from camgen.workbench.form import find_setting, make_form
from camgen.workbench.job_text import keeps_comments, write_job
from camgen.workbench.perform import BuildRequest, Built, InputSummary, PathSummary, run_request
from camgen.workbench.session import Change, apply_changes, open_session, set_value, undo
from camgen.workbench.usual import list_defaults
from tests.support.built import build_once, key_of_files
from tests.test_cases import ALL, CASES, POSTS, parts

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"

# The same bytes.


def tables_of(case: Path, post: str) -> dict[str, Any]:
    """The job of a golden case for a controller, as ``tests/test_cases.py`` has it."""
    job = tomllib.loads((case / "job.toml").read_text())
    for name, table, key in (("posts.toml", "post", ""), ("robots.toml", "cell", "robot")):
        if (case / name).exists():
            found = tomllib.loads((case / name).read_text()).get(post, "" if key else {})
            job[table] = {**job.get(table, {}), key: found} if key else found
    return job


class Called(BaseException):
    """What ``build`` was asked for, in place of its result; goes through whatever catches errors."""

    def __init__(self, inputs: Sequence[Path], **asked: object) -> None:
        super().__init__()
        #: Who watches, and what is read already, make no byte of the program.
        self.asked = {key: value for key, value in asked.items() if key not in ("watch", "files")}
        self.asked = {
            "name": "",
            "strict": False,
            "locate": None,
            "start": None,
            **self.asked,
            "inputs": [path.resolve() for path in inputs],
        }


def call(inputs: Sequence[Path], **asked: object) -> None:
    raise Called(inputs, **asked)


def asked_by_workbench(
    source: Path, job: Path | None, tables: dict[str, Any], post: str, place: Path
) -> Called:
    session = open_session([source], str(job) if job else None, [], post, place, [post])
    asked = [
        Change([table, key], value)
        for table in ("post", "cell")
        for key, value in tables.get(table, {}).items()
    ]
    session = apply_changes(session, asked) if job else session
    # As it would be saved, elsewhere: fixtures stay as they are.
    saved = place / "job.toml" if job else session.job_file
    text = session.text if session.tables or session.base else ""
    if job:
        saved.write_text(text)
    with pytest.raises(Called) as called:
        run_request(
            BuildRequest(1, session.inputs, post, saved, text, session.output),
            ignore_stages,
            list_rows,
        )
    return called.value


def asked_by_line(source: Path, job: Path | None, post: str, place: Path) -> Called:
    words = ["--job", str(place / "job.toml")] if job else []
    with pytest.raises(Called) as called:
        main(["build", str(source), "--post", post, *words, "-o", str(place), "-q"])
    return called.value


DRAWN = sorted(path for path in PARTS.iterdir() if path.suffix != ".toml")
EVERY = [
    (next(part for part in parts(case) if part.exists()), case / "job.toml", post)
    for case, post in ALL
]
EVERY += [(part, None, post) for part in DRAWN for post in POSTS]


def test_every_fixture_is_built_as_the_command_line_builds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same job, input, controller and name to the same ``build``, whose program is written as it is by both: that
    the bytes are the same is then looked at for some.
    """
    monkeypatch.setattr("camgen.workbench.perform.build", call)
    monkeypatch.setattr("camgen.cli.build.build", call)
    jobs = set[int]()
    for number, (source, job, post) in enumerate(EVERY):
        place = tmp_path / str(number)
        place.mkdir()
        tables = tables_of(job.parent, post) if job else {}
        bench, line = (
            asked_by_workbench(source, job, tables, post, place),
            asked_by_line(source, job, post, place),
        )
        assert bench.asked == line.asked, (source.name, job, post)
        assert isinstance(bench.asked["job"], Job)
        jobs.add(hash(repr(bench.asked["job"])))
    assert len(EVERY) >= len(ALL) + len(DRAWN) * len(POSTS) > 150
    assert len(jobs) > len(CASES)


#: Each case for one controller, these in turn.
SOME = [pair for k, pair in enumerate(ALL) if k % len(POSTS) == CASES.index(pair[0]) % len(POSTS)]
SOME += [pair for pair in ALL if pair[0] not in {case for case, _ in SOME}]


@pytest.mark.parametrize(("case", "post"), SOME, ids=lambda one: getattr(one, "name", one))
def test_a_program_is_that_of_the_command_line_byte_for_byte(
    case: Path, post: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = build_once(build, key_of_files)
    monkeypatch.setattr("camgen.workbench.perform.build", once)
    monkeypatch.setattr("camgen.cli.build.build", once)
    source = next(part for part in parts(case) if part.exists())
    (tmp_path / "bench").mkdir()
    (tmp_path / "line").mkdir()
    session = open_session([source], str(case / "job.toml"), [], post, tmp_path / "bench", [post])
    wanted = tables_of(case, post)
    asked = [
        Change([table, key], value)
        for table in ("post", "cell")
        for key, value in wanted.get(table, {}).items()
    ]
    session = apply_changes(session, asked)
    # As it would be saved, elsewhere: fixtures stay as they are.
    job = tmp_path / "job.toml"
    outcome = run_request(
        BuildRequest(1, session.inputs, post, job, session.text, session.output),
        ignore_stages,
        list_rows,
    )
    assert isinstance(outcome, Built), outcome
    job.write_text(session.text)
    words = [str(source), "--post", post, "--job", str(job), "-o", str(tmp_path / "line"), "-q"]
    assert main(["build", *words]) == 0
    written = {path.name: path.read_bytes() for path in (tmp_path / "line").iterdir()}
    assert {path.name: data for path, data in outcome.programs} == written
    assert written


# The form.


def test_every_setting_stands_in_the_form_once() -> None:
    found = make_form("rapid")
    fields = [
        (group.table, field.key)
        for group in found.groups
        if group.table != "post"
        for field in group.fields
    ]
    assert sorted(fields) == sorted((s.table, s.key) for s in list_settings())
    for name, groups in found.rows.items():
        keys = [field.key for group in groups for field in group.fields]
        assert sorted(keys) == sorted({s.key for s in list_row_settings() if s.table == name})
    options = {
        field.key: field
        for group in found.groups
        if group.table == "post"
        for field in group.fields
    }
    assert options["conf"].kind == "choice"


def test_a_field_has_unit_kind_and_bounds_of_its_setting() -> None:
    fields = {
        (group.table, field.key): field
        for group in make_form("gcode").groups
        for field in group.fields
    }
    feed, threshold = fields["process", "feed"], fields["image", "threshold"]
    assert (feed.unit, feed.kind, feed.default) == ("mm/s", "number", 20.0)
    assert (threshold.minimum, threshold.maximum) == (0, 255)
    assert fields["process", "acceleration"].unit == "mm/s2"
    assert fields["tool", "tip_angle"].unit == "deg"
    assert fields["input", "units"].unit == ""
    assert "drill" in fields["operation", "kind"].choices
    assert fields["process", "stay_down"].kind == "flag"
    assert fields["cell", "home"].kind == "free"
    assert "IRB 120" in fields["cell", "robot"].offers


@pytest.mark.parametrize(
    ("error", "place"),
    [
        (
            JobError("part.toml", "feed must be a number > 0, not -1", "[process]"),
            ["process", "feed"],
        ),
        (
            JobError("job", "has no effect without an arm", "cell.joint_speeds"),
            ["cell", "joint_speeds"],
        ),
        (
            JobError("part.dxf", "there is no contour 'c9'", "operations.1.ids"),
            ["operations", 1, "ids"],
        ),
        (
            JobError("part.dxf", "chooses no contour of the drawing", "operations.0"),
            ["operations", 0],
        ),
        (
            JobError("part.toml", "depth must be a number >= 0, not -2", "[[operations]] 1"),
            ["operations", 1, "depth"],
        ),
        (JobError("part.toml", 'conf must be one of "on", not 5', "[post] conf"), ["post", "conf"]),
        (
            JobError("rapid", "no output is named for spindle", "", "set post.signals"),
            ["post", "signals"],
        ),
        (JobError("part.dxf", "is empty"), []),
    ],
)
def test_an_error_names_its_setting(error: JobError, place: list[str | int]) -> None:
    assert find_setting(error) == place


# Defaults that hang on the input.


def usual(tmp_path: Path, post: str, *sets: str) -> dict[str, dict[str, object]]:
    session = open_session([PARTS / "bracket.dxf"], None, sets, post, tmp_path, [post])
    outcome = run_request(
        BuildRequest(1, session.inputs, post, tmp_path / "job.toml", session.text, tmp_path),
        ignore_stages,
        list_rows,
    )
    assert isinstance(outcome, Built), outcome
    return outcome.usual


def test_the_form_shows_what_holds_for_this_input(tmp_path: Path) -> None:
    drawn = usual(tmp_path, "gcode", "tool.diameter=4", "process.feed=30", "process.plunge=2")
    assert drawn["operation"] == {"kind": "follow"}
    # Without what is set: a third of the feed.
    assert drawn["process"]["plunge"] == 10.0
    assert drawn["process"]["travel"] == 100.0
    assert drawn["tolerance"] == {"corner": 0.01}
    assert drawn["cell"]["home"] == [0.0, 0.0, 50.0]
    page = usual(tmp_path, "rapid", "page.size=A4", "tool.diameter=0.8", "tool.kind=pen")
    assert page["operation"] == {"kind": "trace"}
    assert page["tolerance"] == {"corner": pytest.approx(0.04)}  # a twentieth of the pen
    assert len(page["cell"]["base_from_work"]) == 6  # type: ignore[arg-type]
    assert page["process"]["acceleration"] != drawn["process"]["acceleration"]


def test_a_lift_that_is_typed_stays_where_its_default_is_another_one() -> None:
    assert list_defaults({"page": {"size": "A4"}}) == {"process": {"clearance": 3.0}}
    assert (
        list_defaults({})
        == list_defaults({"page": {"margin": 3}})
        == list_defaults({"page": 5})
        == {}
    )
    # 20 is the default elsewhere, and on a page it is not.
    tables = set_value({"page": {"size": "A4"}}, ["process", "clearance"], 20.0)
    assert tables["process"] == {"clearance": 20.0}
    job = from_mapping(tables, Files())
    assert job.process.clearance == 20.0
    assert from_mapping({"page": {"size": "A4"}}, Files()).process.clearance == 3.0
    assert set_value(tables, ["process", "clearance"], None) == {"page": {"size": "A4"}}


# The job file.

FILE = """\
# The bracket, for the small mill.
[tool]            # a 4 mm end mill
diameter = 4.0

# twice as slow as the catalogue says
[process]
feed = 12         # mm/s
clearance = 5.0

[[operations]]
# holes
kind = "drill"

[[operations]]
# outline
depth = 3.0
"""


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["process", "feed"], 15),
        (["process", "plunge"], 3.5),
        (["process", "clearance"], None),
        (["tool", "name"], 'a "long" one\n#'),
        (["operations", 1, "depth"], 4.0),
        (["operations", 0, "holes"], [4.9, 5.1]),
        (["page", "size"], [200.0, 100.0]),
        (["post", "signals"], {"spindle": "aoSpeed", "a b": "c"}),
    ],
)
def test_a_change_leaves_the_rest_of_the_file_as_it_was(
    path: list[str | int], value: object
) -> None:
    wanted = set_value(tomllib.loads(FILE), path, value)
    text = write_job(FILE, wanted, "part.dxf")
    assert tomllib.loads(text) == wanted
    assert keeps_comments(FILE, text)
    assert len(set(FILE.splitlines()) - set(text.splitlines())) <= 1


def test_a_file_that_nothing_changes_stays_byte_for_byte() -> None:
    text = FILE.replace("\n", "\r\n")
    assert write_job(text, tomllib.loads(text), "part.dxf") == text


def test_a_new_file_holds_only_what_differs() -> None:
    tables: dict[str, Any] = {}
    for path, value in (
        (["process", "feed"], 20.0),
        (["process", "plunge"], 5),
        (["tool", "kind"], "drill"),
    ):
        tables = set_value(tables, path, value)
    text = write_job("", {**tables, "operations": [{"kind": "drill"}]}, "part\n.dxf")
    kept = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert kept == [
        "[tool]",
        'kind = "drill"',
        "[process]",
        "plunge = 5",
        "[[operations]]",
        'kind = "drill"',
    ]
    assert set_value(tables, ["process", "plunge"], None) == {"tool": {"kind": "drill"}}


def test_changes_can_be_undone(tmp_path: Path) -> None:
    session = open_session([tmp_path / "part.dxf"], None, [], "gcode", tmp_path, ["gcode"])
    first = apply_changes(session, [Change(["process", "feed"], 12)])
    second = apply_changes(first, [Change(["process", "feed"], raw="  ")])
    assert second.tables == {}
    assert undo(second).tables == first.tables
    assert undo(undo(second)).tables == undo(undo(undo(second))).tables == {}


def test_a_file_of_set_is_named_from_the_job_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "cell.toml").write_text("[cell]\nsafety = 20\n")
    monkeypatch.chdir(tmp_path)
    session = open_session(
        [Path("parts/part.dxf")], None, ["cell.file=cell.toml"], "gcode", tmp_path, ["gcode"]
    )
    assert session.tables == {"cell": {"file": "../cell.toml"}}
    assert apply_changes(session, [Change(["process", "feed"], 12)]).tables["cell"] == {
        "file": "../cell.toml"
    }
    with pytest.raises(JobError, match="outside the open folder"):
        apply_changes(session, [Change(["cell", "file"], "../other.toml")])


@pytest.mark.parametrize(
    "path", [["nothing", "feed"], ["operations"], ["process"], ["operations", 0, "depth"], []]
)
def test_a_place_that_no_job_has_is_refused(tmp_path: Path, path: list[str | int]) -> None:
    session = open_session([tmp_path / "part.dxf"], None, [], "gcode", tmp_path, ["gcode"])
    if path == ["operations"]:
        assert apply_changes(session, [Change(path, [{}])]).tables == {"operations": [{}]}
        return
    with pytest.raises(JobError):
        apply_changes(session, [Change(path, 5)])


# What is chosen.


def test_a_layer_with_signs_of_globs_is_one_layer() -> None:
    off = switch_layer({}, "A[1]*?", on=False)
    assert off == {"input": {"layers": ["*", "!A[[]1][*][?]"]}}
    assert switch_layer(off, "A[1]*?", on=True) == {}
    named = {"input": {"layers": ["OUT*"]}}
    assert switch_layer(named, "HOLES", on=True) == {"input": {"layers": ["OUT*", "HOLES"]}}


def test_edges_are_words_of_the_selection() -> None:
    solid = InputSummary("solid", runs=(PathSummary(("e3",), -1),))
    out = leave_out({}, solid, ["e3"], -1)
    assert out == {"input": {"select": "convex, not e3"}}
    assert restore(out, solid, ["e3"]) == {}
    assert restore({}, solid, ["e4"]) == {"input": {"select": "convex e4"}}
    assert leave_out({"input": {"select": "e3, e5-e9"}}, solid, ["e3"], -1) == {
        "input": {"select": "e5-e9, not e3"}
    }


def test_a_contour_is_left_out_of_the_row_that_works_on_it() -> None:
    looked = InputSummary(
        "drawing", contours=(("c1", "0"), ("c2", "0"), ("c3", "0")), worked=(("c1",), ("c2", "c3"))
    )
    tables = {"operations": [{"nesting": "outer"}, {"nesting": "inner", "depth": 2}]}
    out = leave_out(tables, looked, ["c3"], 1)
    assert out["operations"] == [
        {"nesting": "outer"},
        {"nesting": "inner", "depth": 2, "ids": ["c2"]},
    ]
    assert leave_out(tables, looked, ["c1"], -1)["operations"] == [{"nesting": "inner", "depth": 2}]
    assert restore(out, looked, ["c3"])["operations"][1]["ids"] == ["c2", "c3"]
    with pytest.raises(JobError, match="nothing would be left"):
        leave_out({}, InputSummary("drawing", contours=(("c1", "0"),)), ["c1"], -1)


@pytest.mark.parametrize(
    ("name", "post", "sets", "kind", "layers"),
    [
        ("layers.dxf", "gcode", ["operation.kind=trace"], "drawing", True),
        ("logo.svg", "gcode", ["page.size=A4"], "drawing", True),
        ("space.dxf", "rapid", ["operation.kind=trace"], "curves", True),
        ("old.ngc", "gcode", [], "program", False),
        ("gear.png", "gcode", ["image.mm_per_px=0.2", "operation.kind=trace"], "picture", False),
    ],
)
def test_what_a_page_knows_of_an_input(
    name: str, post: str, sets: list[str], kind: str, layers: bool, tmp_path: Path
) -> None:
    source = tmp_path / name
    if name == "old.ngc":
        source.write_text("G21 G90\nG0 X0 Y0 Z10\nG1 Z0 F300\nG1 X20\nG0 Z10\nM2\n")
    else:
        shutil.copy(PARTS / name, source)
    session = open_session([source], None, sets, post, tmp_path, [post])
    found = run_request(
        BuildRequest(1, session.inputs, post, session.job_file, session.text, tmp_path),
        ignore_stages,
        list_rows,
    )
    assert isinstance(found, Built), found
    assert found.summary.kind == kind
    assert bool(found.summary.layers) == layers
    assert all(layer.used and layer.contours for layer in found.summary.layers)
    assert (found.picture != "") == (kind == "picture")
    assert len(found.summary.runs) > 0


def test_without_its_extra_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    for name in [name for name in sys.modules if name.startswith("camgen.workbench.server")]:
        monkeypatch.delitem(sys.modules, name)
    assert main(["open", str(PARTS / "bracket.dxf"), "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert (
        said == "camgen: error: open: needs uvicorn; "
        "pip install '.[workbench]' in the folder of camgen\n"
    )
