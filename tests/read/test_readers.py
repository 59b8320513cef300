"""Readers are found by content, by suffix and by name. Other packages add readers."""

import importlib
import sys
from itertools import chain
from pathlib import Path

import pytest

from camgen.cli import main
from camgen.model import plugins
from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.read import READERS, find_reader, find_suffix, list_installed, read

BUILT_IN = ["dxf", "gcode", "image", "solid", "svg", "xyz"]
LINE = (
    """
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.read import Reader

def read(source, job, files):
    other = files.read(source.path.with_suffix(".other")).data
    flat = frozen([[0.0, 0.0], [float(other), 0.0]])
"""
    '    return Part(source.stem, source.name, "mm", '
    '(Contour(flat, frozen([0.0, 0.0]), False, "0", "c1"),), ())\n'
    """
def inspect(source, job, files):
    return "a line"

"""
    'LINE = Reader("line", "a line", (".line", ".lin"), "drawing", read, inspect, '
    'lambda head: head.startswith(b"LINE"))\n'
)


def register(folder: Path, monkeypatch: pytest.MonkeyPatch, entry: str, module: str) -> None:
    """Writes a package with a reader, which is found through its metadata like an installed one."""
    (folder / "strange_reader.py").write_text(module)
    info = folder / "strange-3.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 3.1\n")
    (info / "entry_points.txt").write_text(f"[{READERS}]\n{entry}\n")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "strange_reader", raising=False)
    importlib.invalidate_caches()


@pytest.fixture
def _line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    register(tmp_path, monkeypatch, "line = strange_reader:LINE", LINE)


def test_the_built_in_readers_are_registered_like_others() -> None:
    table = {plugin.name: plugin for plugin in list_installed()}
    assert set(BUILT_IN) <= set(table)
    for name in BUILT_IN:
        reader = table[name].reader
        assert reader is not None
        assert (reader.name, table[name].broken) == (name, "")
        assert table[name].origin.startswith("camgen ")
    suffixes = list(chain(*(getattr(table[name].reader, "suffixes", ()) for name in BUILT_IN)))
    assert len(suffixes) == len(set(suffixes))


@pytest.mark.parametrize(
    ("name", "data", "reader"),
    [
        ("a.txt", b"  0\r\nSECTION\r\n", "dxf"),
        ("a.svg", b"AutoCAD Binary DXF\r\n\x1a\x00", "dxf"),
        ("a.dxf", b"\xef\xbb\xbf\n<svg/>", "svg"),
        ("a.dxf", b"\x89PNG\r\n", "image"),
        ("a.dxf", b"", "dxf"),
        ("a", b"999\nmade by hand\n", "dxf"),
        ("a.TIFF", b"", "image"),
        ("a.Step", b"ISO-10303-21;", "solid"),
        ("a.glb", b"glTF", "solid"),
        ("a.tap", b"%\nO1\n", "gcode"),
    ],
)
def test_a_file_is_recognised_by_content_then_by_suffix(
    name: str, data: bytes, reader: str
) -> None:
    assert find_reader(Source(Path(name), data)).name == reader


@pytest.mark.usefixtures("_line")
def test_a_reader_of_another_package_is_found_by_content_suffix_and_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.other").write_text("30")
    for name in ("a.line", "a.bin", "a.LIN"):
        (tmp_path / name).write_text("LINE" if name == "a.bin" else "x")
        assert read(tmp_path / name).contours[0].points[1].tolist() == [30, 0]
    assert find_suffix("line") == ".line"
    assert find_suffix("lin") == ".lin"
    assert main(["inspect", str(tmp_path / "a.line")]) == 0
    assert capsys.readouterr().out == "a line\n"
    (line,) = (plugin for plugin in list_installed() if plugin.name == "line")
    assert (line.origin, line.broken) == ("strange 3.1", "")


@pytest.mark.parametrize("body", ["1 / 0", "exit(0)", "print(head) or None.x", "time.sleep(60)"])
def test_a_reader_that_fails_at_files_of_other_readers_does_not_stop_them(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugins, "SECONDS", 1)
    module = LINE.replace('lambda head: head.startswith(b"LINE")', f"lambda head: {body}")
    module = "import time\nexit = __import__('sys').exit\n" + module
    register(tmp_path, monkeypatch, "line = strange_reader:LINE", module)
    assert find_reader(Source(Path("a.svg"), b"<svg/>")).name == "svg"
    with pytest.raises(
        InputError, match=r"is not a kind of file.*plug-in line: cannot look at a file: "
    ):
        find_reader(Source(Path("a.zzz"), b"what is this"))


@pytest.mark.usefixtures("_line")
def test_a_missing_second_file_of_an_input_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.line").write_text("x")
    with pytest.raises(InputError, match=r"a\.other: no such file"):
        read(tmp_path / "a.line")


@pytest.mark.parametrize(
    ("entry", "module", "reason"),
    [
        (
            "strange_reader:LINE",
            "import no_such_module\n",
            "plug-in line: cannot be loaded: ModuleNotFoundError: No ",
        ),
        (
            "strange_reader:LINE",
            "raise RuntimeError('dongle')\n",
            "plug-in line: cannot be loaded: RuntimeError: dong",
        ),
        ("strange_reader:LINE", "", "AttributeError"),
        (
            "strange_reader:LINE",
            "LINE = 3\n",
            "reader line: is not a camgen.read.Reader (strange_reader:LINE); ",
        ),
        (
            "strange_reader:LINE",
            LINE.replace('Reader("line"', 'Reader("lint"'),
            "reader line: is called lint",
        ),
    ],
)
def test_a_broken_reader_is_listed_with_its_reason_and_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, entry: str, module: str, reason: str
) -> None:
    register(tmp_path, monkeypatch, f"line = {entry}", module)
    (line,) = (plugin for plugin in list_installed() if plugin.name == "line")
    assert reason in line.broken
    assert line.reader is None
    assert find_reader(Source(Path("a.dxf"), b"")).name == "dxf"
    with pytest.raises(
        InputError, match="is not a kind of file that camgen reads; give a DXF drawing, "
    ) as caught:
        find_reader(Source(Path("a.line"), b""))
    assert str(caught.value).endswith(f"; {line.broken}")
    with pytest.raises(JobError) as refused:
        find_suffix("line")
    assert line.broken in str(refused.value)


def test_a_suffix_that_two_readers_claim_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    register(tmp_path, monkeypatch, "line = strange_reader:LINE", LINE.replace('".lin"', '".nc"'))
    with pytest.raises(
        InputError, match=r"a\.nc: is claimed by the readers gcode and line; remove"
    ):
        find_reader(Source(Path("a.nc"), b"G21"))


def test_the_refusal_of_an_unknown_file_lists_the_formats() -> None:
    with pytest.raises(InputError) as caught:
        find_reader(Source(Path("a.doc"), b"x"))
    assert str(caught.value) == (
        "a.doc: is not a kind of file that camgen reads; give a DXF drawing, G-code, "
        "a PNG, JPEG, TIFF, BMP or PGM picture, a PacScript program, a RAPID module, a 3-D part, "
        "an SVG drawing, a V+ program, a list of points in space"
    )


@pytest.mark.parametrize("name", [*BUILT_IN, "png", "step", "nc"])
def test_a_format_is_a_reader_or_a_suffix(name: str) -> None:
    reader = find_reader(Source(Path(f"a{find_suffix(name)}"), b""))
    assert reader.name == name or f".{name}" in reader.suffixes


def test_the_refusal_of_an_unknown_format_lists_the_readers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["build", "-", "--format", "dfx", "--post", "gcode"]) == 2
    assert capsys.readouterr().err == (
        "camgen: error: --format: no reader is called dfx; give one of "
        "dxf, gcode, image, pacscript, rapid, solid, svg, vplus, xyz, or a suffix\n"
    )
