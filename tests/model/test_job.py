import datetime
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import camgen
from camgen.cli.init import write_reference, write_template
from camgen.model.errors import CamgenError, InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.job_tables import list_settings
from camgen.model.part import Contour, Note, Part
from camgen.model.pose import frozen
from camgen.model.toml import format_toml
from camgen.pipeline.inputs import join_parts
from camgen.read.job_file import find_job_file, from_mapping, load_job

ROOT = Path(__file__).parents[2]
PLATE = (
    "0\nSECTION\n2\nENTITIES\n"
    "0\nCIRCLE\n8\nholes\n10\n50\n20\n25\n40\n10\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n0\n11\n100\n21\n0\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n0\n11\n100\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n50\n11\n0\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n50\n11\n0\n21\n0\n"
    "0\nENDSEC\n0\nEOF\n"
)


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    """A DXF (R12, no unit) of a plate of 100 x 50 mm with a hole of 20 mm."""
    file = tmp_path / "plate.dxf"
    file.write_text(PLATE)
    return file


def message(error: pytest.ExceptionInfo[JobError]) -> str:
    return str(error.value)


# Job files


def test_a_job_file_sets_its_keys_and_keeps_the_other_defaults(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("[tool]\ndiameter = 8\n[post]\nwork = 'G55'\n")
    job = load_job(file)
    assert job.tool.diameter == 8.0
    assert job.tool.length == Job().tool.length
    assert job.post == {"work": "G55"}


def test_an_empty_job_is_the_default_job(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("")
    assert load_job(file) == load_job(None) == from_mapping({}) == Job()


def test_a_byte_order_mark_is_ignored(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_bytes(b"\xef\xbb\xbf[tool]\r\ndiameter = 8\r\n")
    assert load_job(file).tool.diameter == 8.0


BAD_FILES = {
    "[tol]\nx = 1": "unknown table [tol]; nearest is [tool]",
    "[tool]\ndiametr = 5": 'unknown key "diametr" ([tool]); nearest is diameter',
    "[tool]\nfeed = 5": 'unknown key "feed" ([tool]); it belongs to [process]',
    "diameter = 5": '"diameter" is outside of its table; it belongs to [tool]',
    "tool = 5": "tool must be a table, not 5; write [tool]",
    "[[tool]]\ndiameter = 5": 'tool must be a table, not [{"diameter": 5}]; write [tool]',
    "[tool]\ndiameter = '5'": 'diameter must be a number > 0, not "5" ([tool])',
    "[tool]\ndiameter = 0": "diameter must be a number > 0, not 0 ([tool])",
    "[tool]\ndiameter = true": "diameter must be a number > 0, not true ([tool])",
    "[tool]\ndiameter = nan": "diameter must be finite, not NaN ([tool])",
    "[process]\nfeed = inf": "feed must be finite, not Infinity ([process])",
    "[cell]\nhome = [0, -inf]": "home must be finite, not [0, -Infinity] ([cell])",
    "[cell]\nhome = [0, 'a']": 'home must be a list of numbers, not [0, "a"] ([cell])',
    "[input]\nlayers = 'A'": 'layers must be a list of texts, not "A" ([input]); write ["A"]',
    "[operation]\npasses = 1.5": "passes must be a whole number >= 1, not 1.5 ([operation])",
    "[tool]\norient = 'folow'": 'orient must be one of "fixed", "follow", not "folow" ([tool])',
    "[operation]\ninside_first = 1": "inside_first must be true or false, not 1 ([operation])",
    "[tool]\ndiameter = 2021-01-01": 'diameter must be a number > 0, not "2021-01-01" ([tool])',
    "[tool]\ndiameter =\n": "is not TOML: Invalid value (line 2, column 11); correct this line",
    "[tool\n": (
        "is not TOML: Expected ']' at the end of a table declaration (line 1, column 6); "
        "correct this line"
    ),
    "[tool]\ndiameter = 1\ndiameter = 2\n": "is not TOML: Cannot overwrite a value "
    "(line 3, column 13); correct this line",
}


@pytest.mark.parametrize("text", BAD_FILES, ids=range(len(BAD_FILES)))
def test_a_fault_of_a_job_file_is_reported_with_its_key_or_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text(text)
    with pytest.raises(JobError) as error:
        load_job(file)
    assert message(error) == f"{file}: {BAD_FILES[text]}"


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"[tool]\n# \xe9\n", "is not UTF-8 text (line 2); save it as UTF-8"),
        (b"a = " + b"[" * 100_000, "is nested too deeply"),
    ],
)
def test_a_file_that_is_not_toml_is_refused(data: bytes, what: str, tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_bytes(data)
    with pytest.raises(JobError) as error:
        load_job(file)
    assert message(error) == f"{file}: {what}"


def test_a_missing_job_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r"none\.toml: cannot be read: No such file"):
        load_job(tmp_path / "none.toml")


# Settings of --set


def test_set_replaces_the_value_of_the_file_and_the_last_set_counts(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("[tool]\ndiameter = 8\nlength = 50\n")
    job = load_job(file, ["tool.diameter=3", "tool.diameter=4", "tour.method=nearest"])
    assert (job.tool.diameter, job.tool.length, job.tour.method) == (4.0, 50.0, "nearest")


@pytest.mark.parametrize(
    ("raw", "value"),
    [
        ("1", 1),
        ("1.5", 1.5),
        ("true", True),
        ('"1"', "1"),
        ("G55", "G55"),
        ("[1, 2]", [1, 2]),
        ("{a = 1}", {"a": 1}),
        ("", ""),
        ("a = b", "a = b"),
        ("1\nb = 2", "1\nb = 2"),
        ("6mm", "6mm"),
        ("2021-01-01", datetime.date(2021, 1, 1)),
    ],
)
def test_a_value_of_set_is_toml_or_else_a_text(raw: str, value: object) -> None:
    assert load_job(None, [f"post.x={raw}"]).post == {"x": value}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("diameter=5", "is not table.key=value; nearest is tool.diameter"),
        ("tool.diameter", "is not table.key=value; nearest is tool.diameter"),
        ("tol.x=1", "unknown table [tol]; nearest is [tool]"),
        ("tool.diametr=5", 'unknown key "diametr" ([tool]); nearest is diameter'),
        (
            "process.feed=1200 rpm",
            'feed must be a number in mm/s or a text with its unit, not "1200 rpm"',
        ),
        (
            "process.feed=nan mm/min",
            'feed must be a number in mm/s or a text with its unit, not "nan mm/min"',
        ),
        ("process.feed=0 mm/min", "feed must be a number > 0"),
        ("process.feed=99999999999 m/min", "feed cannot be beyond "),
        ("tool.diameter=6mm", 'diameter must be a number > 0, not "6mm" ([tool])'),
        ("", "is not table.key=value; write tool.diameter=5"),
    ],
)
def test_a_wrong_set_is_refused_with_its_text(text: str, what: str) -> None:
    with pytest.raises(JobError) as error:
        load_job(None, [text])
    assert message(error).startswith(f"--set {text}: {what}")


@pytest.mark.parametrize(
    ("text", "mm_s"),
    [
        ("1200 mm/min", 20.0),
        ("1.5m/min", 25.0),
        ("60 in/min", 25.4),
        ("2 in/s", 50.8),
        ("15 mm/s", 15.0),
    ],
)
def test_a_speed_may_have_its_unit(text: str, mm_s: float, tmp_path: Path) -> None:
    assert load_job(None, [f"process.feed={text}"]).process.feed == pytest.approx(mm_s, rel=1e-12)
    file = tmp_path / "a.toml"
    file.write_text(
        f'[[tools]]\nname = "a"\nfeed = "{text}"\n[[operations]]\ntool = "a"\ntravel = "{text}"\n'
    )
    process = load_job(file).operations[0].process
    assert (process.feed, process.travel) == pytest.approx((mm_s, mm_s), rel=1e-12)


def test_a_wrong_set_is_reported_as_such_if_there_is_a_job_file(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("[tool]\nlength = 8\n")
    with pytest.raises(JobError, match=r"^--set tool\.length=x: length must be"):
        load_job(file, ["tool.length=x"])


# The template and the page of the documents


def test_the_template_is_the_default_job(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text(write_template("plate.dxf", "inch"), encoding="utf-8")
    assert load_job(file) == Job()
    text = file.read_text(encoding="utf-8")
    assert "This file: inch." in text
    for setting in list_settings():
        assert f"\n{setting.key} = " in text or f"\n# {setting.key} = " in text
        assert setting.about.split()[0] in text


def test_a_name_or_unit_in_the_template_stays_in_its_comment() -> None:
    template = write_template("a\n[tool]\ndiameter = 1\r.dxf", "mm\u2028x\x85[x]")
    assert tomllib.loads(template)["tool"]["diameter"] == 6.0


@given(
    st.recursive(
        st.text()
        | st.integers(-(2**53), 2**53)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.booleans(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_a_value_that_is_written_as_toml_is_read_back(value: object) -> None:
    assert tomllib.loads(f"x = {format_toml(value)}")["x"] == value


def test_the_page_of_the_documents_is_current() -> None:
    assert (ROOT / "docs" / "job.md").read_text(encoding="utf-8") == write_reference()


def test_the_job_file_has_the_name_of_the_input_unless_it_is_given(tmp_path: Path) -> None:
    drawing, job = tmp_path / "a b.dxf", tmp_path / "a b.toml"
    assert find_job_file(None, drawing) is None
    job.write_text("")
    assert find_job_file(None, drawing) == job
    assert find_job_file("other.toml", drawing) == Path("other.toml")
    assert find_job_file(None, None) is None
    assert find_job_file(None, job) is None  # never the input itself
    assert find_job_file(None, Path("x" * 5000)) is None
    assert find_job_file(None, Path("a\0b")) is None


# Builds


def test_a_build_in_python_returns_its_files(plate: Path) -> None:
    result = camgen.build(plate, post="gcode", job={"operation": {"kind": "trace"}})
    assert [file.name for file in result.files] == ["plate.ngc"]
    assert result.text == result.files[0].text
    # The plate has a border of 300 mm, and the hole one of 20 pi.
    tour = result.report["tour"]
    assert tour["work_mm"] == pytest.approx(300 + 62.832, abs=1e-3)  # type: ignore[index]
    assert result.deviation.max_mm < 0.001
    assert not list(plate.parent.glob("*.ngc"))


def test_a_job_always_gives_one_text_and_another_job_another_hash(plate: Path) -> None:
    first = camgen.build(plate, post="rapid", job={"tool": {"diameter": 4}})
    assert camgen.build(str(plate), post="rapid", job=Job()).text != first.text
    assert camgen.build([plate], post="rapid", job={"tool": {"diameter": 4.0}}).text == first.text
    plate.write_text(PLATE.replace("EOF\n", "EOF\n\n"))
    other = camgen.build(plate, post="rapid", job={"tool": {"diameter": 4}})
    assert other.program.header[0] != first.program.header[0]
    assert other.program.header[1:] == first.program.header[1:]


def test_the_header_states_part_post_units_tool_and_frame(plate: Path) -> None:
    text = camgen.build(plate, post="gcode", job={"tool": {"diameter": 4.5}}).text
    for part in (
        "part: plate.dxf",
        "post: gcode",
        "units: mm",
        "diameter 4.5 mm",
        "work frame: 0 0 0 0 0 0",
    ):
        assert part in text
    assert f"camgen {camgen.__version__} - job " in text


def test_a_build_in_python_reads_a_job_file_only_if_it_is_given(plate: Path) -> None:
    plate.with_suffix(".toml").write_text("[tool]\ndiameter = 'x'\n")
    camgen.build(plate, post="gcode")
    with pytest.raises(JobError, match="diameter must be a number"):
        camgen.build(plate, post="gcode", job=plate.with_suffix(".toml"))


def test_several_inputs_are_one_program_with_distinct_ids(plate: Path) -> None:
    second = plate.with_name("second.dxf")
    # The same plate 200 mm to the right.
    lines = PLATE.split("\n")
    for k in range(0, len(lines) - 1, 2):
        if lines[k] in ("10", "11"):
            lines[k + 1] = str(int(lines[k + 1]) + 200)
    second.write_text("\n".join(lines))
    result = camgen.build([plate, second], post="gcode", job={"operation": {"kind": "trace"}})
    ids = [path.id for path in result.tour.paths]
    assert len(ids) == len(set(ids)) == 4
    assert result.files[0].name == "plate.ngc"
    assert result.part.source == "plate.dxf + second.dxf"
    assert "part: plate.dxf" in result.text
    assert "part: second.dxf" in result.text
    assert result.motions.extents is not None
    assert result.motions.extents[1][0] == pytest.approx(300)


def test_notes_of_joined_parts_name_their_file() -> None:
    contour = Contour(frozen([[0, 0], [1, 1]]), frozen([0, 0]), False, "", "c1")
    parts = [
        Part(n, f"{n}.dxf", u, (contour,), (Note("joined", "2 ends"),))
        for n, u in (("a", "mm"), ("b", "inch"))
    ]
    both = join_parts(parts)
    assert [c.id for c in both.contours] == ["1/c1", "2/c1"]
    assert [n.what for n in both.notes] == ["a.dxf: 2 ends", "b.dxf: 2 ends"]
    assert (both.name, both.source, both.units) == ("a", "a.dxf + b.dxf", "mm + inch")
    assert join_parts(parts[:1]) is parts[0]


def test_an_input_that_is_given_twice_is_refused(plate: Path) -> None:
    link = plate.with_name("link.dxf")
    link.symlink_to(plate)
    with pytest.raises(InputError, match=r"link\.dxf: is given twice"):
        camgen.build([plate, link], post="gcode")


def test_a_build_without_an_input_is_refused() -> None:
    with pytest.raises(InputError, match="none is given"):
        camgen.build([], post="gcode")


def test_strict_refuses_a_program_that_leaves_out_a_contour(plate: Path) -> None:
    job = {"tool": {"diameter": 30}}  # wider than the hole
    assert any(n.kind == "skipped" for n in camgen.build(plate, post="gcode", job=job).notes)
    with pytest.raises(
        NoSafeProgram, match=r"plate\.dxf: --strict and 1 left out, first: .*c1"
    ) as error:
        camgen.build(plate, post="gcode", job=job, strict=True)
    assert error.value.exit_code == 3


def test_a_program_without_paths_is_refused_with_the_reason(plate: Path) -> None:
    plate.write_text(PLATE[: PLATE.index("0\nLINE")] + "0\nENDSEC\n0\nEOF\n")
    with pytest.raises(NoSafeProgram, match=r"plate\.dxf: no path is left: .*does not fit"):
        camgen.build(
            plate, post="gcode", job={"tool": {"diameter": 30}, "operation": {"side": "inside"}}
        )


def test_an_unknown_post_or_option_is_refused_with_the_nearest_one(plate: Path) -> None:
    with pytest.raises(JobError, match="post rapd: is not installed; nearest is rapid"):
        camgen.build(plate, post="rapd")
    with pytest.raises(
        JobError, match=r"job: gcode has no such option \(\[post\] wrk\); nearest is work"
    ):
        camgen.build(plate, post="gcode", job={"post": {"wrk": "G55"}})


def test_stages_are_reported_in_order(plate: Path) -> None:
    stages: list[str] = []
    camgen.build(plate, post="gcode", watch=stages.append)
    assert stages == ["reading", "planning", "ordering", "programming", "verifying"]


def test_importing_camgen_imports_no_numpy() -> None:
    code = (
        "import sys, camgen, camgen.cli; camgen.__version__; print('numpy' in sys.modules, "
        "camgen.build.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False build\n"


def test_an_unknown_name_of_the_package_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="bild"):
        _ = camgen.bild  # type: ignore[attr-defined]


def test_an_input_that_cannot_be_read_is_a_camgen_error(plate: Path) -> None:
    for source in (
        plate.parent,
        plate.with_name("none.dxf"),
        Path("/dev/null"),
        Path("x" * 5000),
        Path("a\0b"),
    ):
        with pytest.raises(CamgenError) as error:
            camgen.build(source, post="gcode")
        assert error.value.exit_code == 2


def test_the_radius_of_a_tool_is_half_its_diameter() -> None:
    assert from_mapping({"tool": {"diameter": 7.0}}).tool.radius == 3.5
