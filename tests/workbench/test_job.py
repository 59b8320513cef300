"""The job of the workbench: its form, its file, and programs equal to those of the command line."""

import shutil
import sys
import tomllib
from collections.abc import Sequence
from itertools import product
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
from camgen.workbench.form import Field, Group, find_setting, make_form
from camgen.workbench.job_text import keeps_comments, write_job
from camgen.workbench.perform import BuildRequest, Built, InputSummary, PathSummary, run_request
from camgen.workbench.session import Change, apply_changes, open_session, set_value, undo
from camgen.workbench.usual import list_defaults
from tests.support.built import build_once, key_of_files
from tests.test_cases import ALL, CASES, POSTS, find_part

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"

# Programs of the workbench and of the command line.


def read_tables(case: Path, post: str) -> dict[str, Any]:
    """The job of a golden case for a controller, as in `tests/test_cases.py`."""
    job = tomllib.loads((case / "job.toml").read_text())
    options, robots = case / "posts.toml", case / "robots.toml"
    if options.exists():
        job["post"] = tomllib.loads(options.read_text()).get(post, {})
    if robots.exists():
        robot = tomllib.loads(robots.read_text()).get(post, "")
        job["cell"] = {**job.get("cell", {}), "robot": robot}
    return job


class BuildCall(BaseException):
    """The arguments of a call of `build`. No handler of errors catches it.

    arguments: without `watch` and `files`, which do not change the program.
    """

    def __init__(self, inputs: Sequence[Path], **arguments: object) -> None:
        super().__init__()
        self.arguments = {
            "name": "",
            "strict": False,
            "locate": None,
            "start": None,
            **arguments,
            "inputs": [path.resolve() for path in inputs],
        }
        for name in ("watch", "files"):
            self.arguments.pop(name, None)


def raise_call(inputs: Sequence[Path], **arguments: object) -> None:
    """Stands in for `build`."""
    raise BuildCall(inputs, **arguments)


def list_changes(tables: dict[str, Any]) -> list[Change]:
    """A change for each setting of [post] and [cell]."""
    changes: list[Change] = []
    for table in ("post", "cell"):
        for key, value in tables.get(table, {}).items():
            changes.append(Change([table, key], value))
    return changes


def call_from_workbench(
    source: Path, job: Path | None, tables: dict[str, Any], post: str, folder: Path
) -> BuildCall:
    session = open_session([source], str(job) if job else None, [], post, folder, [post])
    session = apply_changes(session, list_changes(tables)) if job else session
    # The job is saved in another folder: the fixtures stay unchanged.
    saved = folder / "job.toml" if job else session.job_file
    text = session.text if session.tables or session.base else ""
    if job:
        saved.write_text(text)
    with pytest.raises(BuildCall) as caught:
        run_request(
            BuildRequest(1, session.inputs, post, saved, text, session.output),
            ignore_stages,
            list_rows,
        )
    return caught.value


def call_from_command_line(source: Path, job: Path | None, post: str, folder: Path) -> BuildCall:
    words = ["--job", str(folder / "job.toml")] if job else []
    with pytest.raises(BuildCall) as caught:
        main(["build", str(source), "--post", post, *words, "-o", str(folder), "-q"])
    return caught.value


DRAWN = sorted(path for path in PARTS.iterdir() if path.suffix != ".toml")
BUILDS = [(find_part(case), case / "job.toml", post) for case, post in ALL]
BUILDS += [(part, None, post) for part, post in product(DRAWN, POSTS)]


def test_every_fixture_is_built_as_the_command_line_builds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workbench and command line call `build` with equal jobs, inputs, controllers and names.

    Both write the program of `build` unchanged; the next test compares the bytes of a sample.
    """
    monkeypatch.setattr("camgen.workbench.perform.build", raise_call)
    monkeypatch.setattr("camgen.cli.build.build", raise_call)
    jobs = set[int]()
    for index, (source, job, post) in enumerate(BUILDS):
        folder = tmp_path / str(index)
        folder.mkdir()
        tables = read_tables(job.parent, post) if job else {}
        of_bench, of_line = (
            call_from_workbench(source, job, tables, post, folder),
            call_from_command_line(source, job, post, folder),
        )
        assert of_bench.arguments == of_line.arguments, (source.name, job, post)
        assert isinstance(of_bench.arguments["job"], Job)
        jobs.add(hash(repr(of_bench.arguments["job"])))
    assert len(BUILDS) >= len(ALL) + len(DRAWN) * len(POSTS) > 150
    assert len(jobs) > len(CASES)


#: Each case for one controller; all controllers in turn.
SAMPLE = [pair for k, pair in enumerate(ALL) if k % len(POSTS) == CASES.index(pair[0]) % len(POSTS)]
_SAMPLED = {case for case, _ in SAMPLE}
SAMPLE += [pair for pair in ALL if pair[0] not in _SAMPLED]


@pytest.mark.parametrize(("case", "post"), SAMPLE, ids=lambda value: getattr(value, "name", value))
def test_the_workbench_writes_the_bytes_of_the_command_line(
    case: Path, post: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = build_once(build, key_of_files)
    monkeypatch.setattr("camgen.workbench.perform.build", builder)
    monkeypatch.setattr("camgen.cli.build.build", builder)
    source = find_part(case)
    (tmp_path / "bench").mkdir()
    (tmp_path / "line").mkdir()
    session = open_session([source], str(case / "job.toml"), [], post, tmp_path / "bench", [post])
    session = apply_changes(session, list_changes(read_tables(case, post)))
    # The job is saved in another folder: the fixtures stay unchanged.
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


def list_fields(groups: Sequence[Group]) -> list[tuple[str, Field]]:
    """The fields of groups, each with the table of its group."""
    fields: list[tuple[str, Field]] = []
    for group in groups:
        fields += [(group.table, field) for field in group.fields]
    return fields


def test_each_setting_is_in_the_form_once() -> None:
    form = make_form("rapid")
    fields = [(table, field.key) for table, field in list_fields(form.groups)]
    settings = [name for name in fields if name[0] != "post"]
    assert sorted(settings) == sorted((setting.table, setting.key) for setting in list_settings())
    for name, groups in form.rows.items():
        keys = [field.key for _, field in list_fields(groups)]
        expected = {setting.key for setting in list_row_settings() if setting.table == name}
        assert sorted(keys) == sorted(expected)
    options = {field.key: field for table, field in list_fields(form.groups) if table == "post"}
    assert options["conf"].kind == "choice"


def test_a_field_has_unit_kind_and_bounds_of_its_setting() -> None:
    groups = make_form("gcode").groups
    fields = {(table, field.key): field for table, field in list_fields(groups)}
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


# Defaults that depend on the input.


def find_defaults(tmp_path: Path, post: str, *sets: str) -> dict[str, dict[str, object]]:
    """The defaults of settings that a build of the bracket shows in the form."""
    session = open_session([PARTS / "bracket.dxf"], None, sets, post, tmp_path, [post])
    outcome = run_request(
        BuildRequest(1, session.inputs, post, tmp_path / "job.toml", session.text, tmp_path),
        ignore_stages,
        list_rows,
    )
    assert isinstance(outcome, Built), outcome
    return outcome.usual


def test_the_form_shows_the_defaults_for_its_input(tmp_path: Path) -> None:
    drawn = find_defaults(
        tmp_path, "gcode", "tool.diameter=4", "process.feed=30", "process.plunge=2"
    )
    assert drawn["operation"] == {"kind": "follow"}
    # The default without the given plunge: a third of the feed.
    assert drawn["process"]["plunge"] == 10.0
    assert drawn["process"]["travel"] == 100.0
    assert drawn["tolerance"] == {"corner": 0.01}
    assert drawn["cell"]["home"] == [0.0, 0.0, 50.0]
    page = find_defaults(tmp_path, "rapid", "page.size=A4", "tool.diameter=0.8", "tool.kind=pen")
    assert page["operation"] == {"kind": "trace"}
    assert page["tolerance"] == {"corner": pytest.approx(0.04)}  # a twentieth of the pen
    assert len(page["cell"]["base_from_work"]) == 6  # type: ignore[arg-type]
    assert page["process"]["acceleration"] != drawn["process"]["acceleration"]


def test_a_clearance_equal_to_another_default_is_kept() -> None:
    assert list_defaults({"page": {"size": "A4"}}) == {"process": {"clearance": 3.0}}
    assert (
        list_defaults({})
        == list_defaults({"page": {"margin": 3}})
        == list_defaults({"page": 5})
        == {}
    )
    # 20 mm is the default without a page. On a page it is another value than the default, 3 mm.
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
def test_a_change_keeps_the_other_lines_of_the_file(path: list[str | int], value: object) -> None:
    expected = set_value(tomllib.loads(FILE), path, value)
    text = write_job(FILE, expected, "part.dxf")
    assert tomllib.loads(text) == expected
    assert keeps_comments(FILE, text)
    assert len(set(FILE.splitlines()) - set(text.splitlines())) <= 1


def test_a_file_without_changes_stays_byte_for_byte() -> None:
    text = FILE.replace("\n", "\r\n")
    assert write_job(text, tomllib.loads(text), "part.dxf") == text


def test_a_new_file_holds_only_values_other_than_the_defaults() -> None:
    tables: dict[str, Any] = {}
    for path, value in (
        (["process", "feed"], 20.0),
        (["process", "plunge"], 5),
        (["tool", "kind"], "drill"),
    ):
        tables = set_value(tables, path, value)
    text = write_job("", {**tables, "operations": [{"kind": "drill"}]}, "part\n.dxf")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert lines == [
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


def test_a_file_of_set_becomes_relative_to_the_job_file(
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
def test_an_unknown_setting_is_refused(tmp_path: Path, path: list[str | int]) -> None:
    session = open_session([tmp_path / "part.dxf"], None, [], "gcode", tmp_path, ["gcode"])
    if path == ["operations"]:
        assert apply_changes(session, [Change(path, [{}])]).tables == {"operations": [{}]}
        return
    with pytest.raises(JobError):
        apply_changes(session, [Change(path, 5)])


# The selection of layers, edges and contours.


def test_the_characters_of_globs_in_a_layer_are_escaped() -> None:
    without_layer = switch_layer({}, "A[1]*?", on=False)
    assert without_layer == {"input": {"layers": ["*", "!A[[]1][*][?]"]}}
    assert switch_layer(without_layer, "A[1]*?", on=True) == {}
    named = {"input": {"layers": ["OUT*"]}}
    assert switch_layer(named, "HOLES", on=True) == {"input": {"layers": ["OUT*", "HOLES"]}}


def test_edges_are_left_out_by_words_of_the_selection() -> None:
    solid = InputSummary("solid", runs=(PathSummary(("e3",), -1),))
    tables_without = leave_out({}, solid, ["e3"], -1)
    assert tables_without == {"input": {"select": "convex, not e3"}}
    assert restore(tables_without, solid, ["e3"]) == {}
    assert restore({}, solid, ["e4"]) == {"input": {"select": "convex e4"}}
    assert leave_out({"input": {"select": "e3, e5-e9"}}, solid, ["e3"], -1) == {
        "input": {"select": "e5-e9, not e3"}
    }


def test_a_contour_is_left_out_of_the_row_that_works_on_it() -> None:
    summary = InputSummary(
        "drawing", contours=(("c1", "0"), ("c2", "0"), ("c3", "0")), worked=(("c1",), ("c2", "c3"))
    )
    tables = {"operations": [{"nesting": "outer"}, {"nesting": "inner", "depth": 2}]}
    tables_without = leave_out(tables, summary, ["c3"], 1)
    assert tables_without["operations"] == [
        {"nesting": "outer"},
        {"nesting": "inner", "depth": 2, "ids": ["c2"]},
    ]
    assert leave_out(tables, summary, ["c1"], -1)["operations"] == [
        {"nesting": "inner", "depth": 2}
    ]
    assert restore(tables_without, summary, ["c3"])["operations"][1]["ids"] == ["c2", "c3"]
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
def test_the_summary_of_an_input_has_kind_layers_and_paths(
    name: str, post: str, sets: list[str], kind: str, layers: bool, tmp_path: Path
) -> None:
    source = tmp_path / name
    if name == "old.ngc":
        source.write_text("G21 G90\nG0 X0 Y0 Z10\nG1 Z0 F300\nG1 X20\nG0 Z10\nM2\n")
    else:
        shutil.copy(PARTS / name, source)
    session = open_session([source], None, sets, post, tmp_path, [post])
    outcome = run_request(
        BuildRequest(1, session.inputs, post, session.job_file, session.text, tmp_path),
        ignore_stages,
        list_rows,
    )
    assert isinstance(outcome, Built), outcome
    assert outcome.summary.kind == kind
    assert bool(outcome.summary.layers) == layers
    assert all(layer.used and layer.contours for layer in outcome.summary.layers)
    assert (outcome.picture != "") == (kind == "picture")
    assert len(outcome.summary.runs) > 0


def test_without_its_extra_the_command_names_the_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    for name in [name for name in sys.modules if name.startswith("camgen.workbench.server")]:
        monkeypatch.delitem(sys.modules, name)
    assert main(["open", str(PARTS / "bracket.dxf"), "--no-browser"]) == 2
    message = capsys.readouterr().err
    assert (
        message == "camgen: error: open: needs uvicorn; "
        "pip install '.[workbench]' in the folder of camgen\n"
    )
