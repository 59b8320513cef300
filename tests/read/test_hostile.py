"""Inputs that are made to break a reader are refused.

A refusal prints one line and exits with 2. It writes nothing and takes little memory and few calls.
"""

import json
import os
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.model.errors import InputError
from camgen.model.limits import Limits
from camgen.read.solid import mesh_file
from camgen.read.solid.part21 import find_wild_id
from docs.make.limits import format_limits
from tests.support.files import source
from tests.support.steps import count_calls

Captured = pytest.CaptureFixture[str]
ENTITIES = "0\nSECTION\n2\nENTITIES\n"
END = "0\nENDSEC\n0\nEOF\n"
CIRCLE = "0\nCIRCLE\n8\n0\n10\n50\n20\n25\n40\n10\n"
LINE = "0\nLINE\n8\n0\n10\n0\n20\n0\n11\n1\n21\n1\n"
TEXT = "0\nTEXT\n8\n0\n10\n0\n20\n0\n40\n1\n1\nx\n"
STEP = Path(__file__).parents[2] / "fixtures" / "parts"
#: Maximum number of calls before a refusal: a hundred for each of the 100,000 elements to which the
#: references of an SVG drawing may expand. Elements are counted while they are made.
MOST_CALLS = 10_000_000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory of a test, with a drawing `plate.dxf`."""
    (tmp_path / "plate.dxf").write_text(ENTITIES + CIRCLE + END)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_refused(words: list[str], folder: Path, capsys: Captured) -> str:
    """The message of a command that must be refused after few calls, with nothing written."""
    before = sorted(folder.rglob("*"))
    codes = []
    assert count_calls(lambda: codes.append(main(words))) < MOST_CALLS
    assert codes == [2]
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("camgen: error: ")
    assert printed.err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before
    return printed.err.removeprefix("camgen: error: ")


def block(name: str, body: str) -> str:
    return f"0\nBLOCK\n8\n0\n2\n{name}\n70\n0\n10\n0\n20\n0\n30\n0\n{body}0\nENDBLK\n"


def insert(name: str, x: int = 0, more: str = "") -> str:
    return f"0\nINSERT\n8\n0\n2\n{name}\n10\n{x}\n20\n0\n30\n0\n{more}"


def drawing(blocks: str, entities: str) -> str:
    return f"0\nSECTION\n2\nBLOCKS\n{blocks}0\nENDSEC\n{ENTITIES}{entities}{END}"


def nested(levels: int, each: int, inmost: str = LINE) -> str:
    """A drawing whose blocks insert each other `levels` deep, `each` times on a level."""
    blocks = []
    for k in range(levels):
        inserts = "".join(insert(f"b{k + 1}", i) for i in range(each))
        blocks.append(block(f"b{k}", inserts))
    return drawing("".join(blocks) + block(f"b{levels}", inmost), insert("b0"))


def array(columns: int, rows: int, body: str = LINE) -> str:
    return drawing(block("b", body), insert("b", 0, f"70\n{columns}\n71\n{rows}\n44\n1\n45\n1\n"))


def svg(body: str, size: str = 'width="100mm" height="100mm"') -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{body}</svg>'


USES = "".join(f'<g id="g{k}">' + f'<use href="#g{k + 1}"/>' * 10 + "</g>" for k in range(10))
PLY = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
DIGITS = "9" * 5000

HOSTILE = {
    "ten levels of ten.dxf": (nested(10, 10), "blocks expand to more than 1,000,000 entities"),
    "of no curve.dxf": (nested(10, 10, TEXT), "blocks expand to more than 1,000,000 entities"),
    "a thousand deep.dxf": (nested(1000, 1), "blocks stand more than 64 deep within each other"),
    "array.dxf": (array(1700, 1700), "blocks expand to more than 1,000,000 entities"),
    "empty array.dxf": (array(30_000, 30_000, ""), "blocks expand to more than 1,000,000 entities"),
    "digits.dxf": (
        ENTITIES + CIRCLE.replace("\n40\n10\n", f"\n40\n{DIGITS}\n") + END,
        "nothing to machine",
    ),
    "uses.svg": (
        svg(USES + '<g id="g10"/>'),
        "its references draw more than 100,000 elements",
    ),
    "small arc.svg": (
        svg('<path d="M0 0 A1e-300 1e-300 0 0 1 9 9"/>'),
        "an arc that is too large",
    ),
    "large arc.svg": (svg('<path d="M0 0 A1e308 1e308 0 0 1 9 9"/>'), "an arc that is too large"),
    "page.svg": (
        svg('<path d="M0 0h9"/>', 'width="1e308mm" height="9"'),
        "width is beyond 1,000,000 mm",
    ),
    "no format.ply": ("ply\n" + PLY, "is damaged or no PLY mesh"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused(name: str, folder: Path, capsys: Captured) -> None:
    text, message = HOSTILE[name]
    (folder / name).write_text(text)
    assert message in run_refused(["build", name, "--post", "rapid"], folder, capsys)


def test_nested_blocks_within_the_limits_are_read(folder: Path) -> None:
    (folder / "nested.dxf").write_text(nested(3, 10))
    (folder / "deep.dxf").write_text(nested(60, 1))
    for name in ("nested.dxf", "deep.dxf"):
        assert main(["inspect", name]) == 0


SETTINGS = {
    "tool.diameter=1e20": "diameter cannot be beyond 1,000,000: 1e+20 ([tool])",
    "page.size=[1e308,1e308]": "size cannot be beyond 1,000,000",
    "operation.passes=100000": "passes must be 1,000 at most, not 100000 ([operation])",
    "operation.passes=99999999999999999999999": "passes cannot be beyond 1,000,000",
    f"operation.passes={DIGITS}": "passes must be a whole number",
    f"tour.seed={DIGITS}": "seed must be a whole number",
    "operation.stepover=1e-7": "stepover must be 0.01 at least, not 1e-07",
    "tolerance.chord=1e-12": "chord must be 1e-06 at least, not 1e-12",
    "cell.fixtures=[[0,0,0,1,1,1e300]]": "fixtures cannot be beyond 1,000,000",
}


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda text: text[:30])
def test_a_hostile_setting_is_refused(setting: str, folder: Path, capsys: Captured) -> None:
    words = ["build", "plate.dxf", "--post", "gcode", "--set", setting]
    message = run_refused(words, folder, capsys)
    assert SETTINGS[setting] in message
    assert len(message) < 400


def test_a_number_of_5000_digits_in_a_job_file_is_refused(folder: Path, capsys: Captured) -> None:
    (folder / "plate.toml").write_text(f"[tour]\nseed = {DIGITS}\n")
    assert "plate.toml: holds a number of too many digits" in run_refused(
        ["build", "plate.dxf", "--post", "gcode"], folder, capsys
    )


@pytest.mark.parametrize("kind", ["[[1, 2]]", "{a = 1}", "3", "true"])
def test_a_kind_of_operation_that_is_not_a_text_is_refused(
    kind: str, folder: Path, capsys: Captured
) -> None:
    (folder / "a.dxf").write_text(
        "0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n10\n5\n20\n5\n40\n3\n0\nENDSEC\n0\nEOF\n"
    )
    (folder / "a.toml").write_text(f"[operation]\nkind = {kind}\n")
    assert "kind" in run_refused(["build", "a.dxf", "--post", "gcode"], folder, capsys)


@pytest.mark.usefixtures("folder")
def test_a_seed_may_be_large() -> None:
    assert main(["build", "plate.dxf", "--post", "gcode", "--set", "tour.seed=4000000000"]) == 0


# -- plans and programs


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"speed":', '"speed":1e20,"was":'),
        ('"path":0', f'"path":{10**20}'),
        ('"via":[', '"via":[1e308,'),
        ("[[1.0", "[[1e308"),
    ],
)
def test_a_plan_with_numbers_out_of_range_is_refused(
    old: str, new: str, folder: Path, capsys: Captured
) -> None:
    words = ["build", "plate.dxf", "--post", "gcode", "-o", "p.ngc", "--plan", "p.json", "-q"]
    assert main(words) == 0
    plan = (folder / "p.json").read_text()
    assert old in plan
    (folder / "p.json").write_text(plan.replace(old, new))
    message = run_refused(
        ["verify", "p.ngc", "--post", "gcode", "--plan", "p.json"], folder, capsys
    )
    assert message.startswith("p.json: is not a plan: ")


#: Bytes above ASCII. Python reads some of them as a digit, a space or the end of a line.
HIGH_BYTES = [0x80, 0x85, 0xA0, 0xAA, 0xB2, 0xB3, 0xB9, 0xBC, 0xDF, 0xFF]


@pytest.mark.parametrize("post", ["gcode", "grbl"])
@pytest.mark.parametrize(
    "line", ["G1 X# F100", "N# G1 X1", "T# M6", "G#", "O# sub", "##=1", "G1 X1 #"]
)
def test_a_byte_beyond_ascii_in_a_program_is_refused(
    post: str, line: str, folder: Path, capsys: Captured
) -> None:
    for byte in HIGH_BYTES:
        text = f"G21 G90\nG1 X9 F100\n{line}\nM2\n".encode().replace(b"#", bytes([byte]))
        (folder / "p.ngc").write_bytes(text)
        assert main(["verify", "p.ngc", "--post", post]) == 2, (post, line, hex(byte))
        assert capsys.readouterr().err.startswith("camgen: error: p.ngc: ")


def test_a_batch_reports_a_file_whose_name_is_not_text(folder: Path, capsys: Captured) -> None:
    name = os.fsdecode(b"p\xff.dxf")
    try:
        (folder / name).write_text(ENTITIES + CIRCLE + END)
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    assert main(["batch", "*.dxf", "--post", "gcode", "-o", "out", "--report", "report.json"]) == 2
    printed = capsys.readouterr()
    assert "failed    p .dxf: its name is not UTF-8 text; rename it\n" in printed.err
    report = json.loads((folder / "report.json").read_text())
    assert [part["exit_code"] for part in report["parts"]] == [0, 2]
    assert (folder / "out" / "plate.ngc").exists()


# -- devices and pipes

#: Commands by the use of the file `#`, which is replaced by a device or a pipe.
COMMANDS = {
    "input": ["build", "#", "--post", "gcode"],
    "job": ["build", "plate.dxf", "--post", "gcode", "--job", "#"],
    "cell": ["build", "plate.dxf", "--post", "gcode", "--set", "cell.file=#"],
    "fixture": ["build", "plate.dxf", "--post", "gcode", "--set", 'cell.fixtures=["#"]'],
    "arm": ["build", "plate.dxf", "--post", "gcode", "--set", "cell.robot=#.urdf"],
    "plan": ["verify", "plate.dxf", "--post", "gcode", "--plan", "#"],
    "program": ["verify", "#", "--post", "gcode"],
    "photo": ["calibrate", "#", "--board", "9x6", "--square", "20", "-o", "camera.yaml"],
    "scan": ["localize", "cube.stl", "#", "-o", "found.toml"],
    "part of a batch": ["batch", "#", "--post", "gcode"],
    "job of a batch": ["batch", "plate.dxf", "--post", "gcode", "--job", "#"],
    "post": ["build", "plate.dxf", "--post", "#.py"],
}


@pytest.mark.parametrize("kind", ["device", "pipe"])
@pytest.mark.parametrize("use", COMMANDS)
def test_a_device_or_a_pipe_is_refused_as_input(
    use: str, kind: str, folder: Path, capsys: Captured
) -> None:
    corners = "".join(f"vertex {x} {y} 0\n" for x, y in ((0, 0), (9, 0), (0, 9)))
    facet = f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
    (folder / "cube.stl").write_text(f"solid m\n{facet}endsolid m\n")
    for name in ("odd", "odd.urdf", "odd.py"):
        if kind == "pipe":
            os.mkfifo(folder / name)
        else:
            (folder / name).symlink_to("/dev/zero")
    words = [word.replace("#", "odd") for word in COMMANDS[use]]
    message = run_refused(words, folder, capsys)
    reasons = ("is not a regular file", "is not a file", "no such file")
    assert any(reason in message for reason in reasons)


def test_a_pipe_in_the_place_of_the_state_of_a_batch_is_refused(
    folder: Path, capsys: Captured
) -> None:
    os.mkfifo(folder / "camgen-batch.jsonl")
    assert "camgen-batch.jsonl: is not a regular file" in run_refused(
        ["batch", "plate.dxf", "--post", "gcode"], folder, capsys
    )


# -- pictures and solids


def png(side: int, bits: int, colour: int) -> bytes:
    """The head of a square PNG alone. It states the size, which is read before any pixel.

    side: pixels along a side
    bits: bits of each channel
    colour: kind of colour as PNG counts it, 0 for grey and 6 for RGB with alpha
    """

    def chunk(name: bytes, data: bytes) -> bytes:
        checksum = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data)) + name + data + checksum

    head = struct.pack(">IIBBBBB", side, side, bits, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def test_a_picture_of_too_many_bytes_or_pixels_is_refused(folder: Path, capsys: Captured) -> None:
    (folder / "deep.png").write_bytes(png(14_000, 16, 6))
    (folder / "wide.png").write_bytes(png(15_000, 8, 0))
    words = ["--post", "gcode", "--set", "image.mm_per_px=0.1"]
    message = run_refused(["build", "deep.png", *words], folder, capsys)
    assert "deep.png: its pixels take 1,568,000,000 bytes, more than 600,000,000" in message
    message = run_refused(["build", "wide.png", *words], folder, capsys)
    assert "wide.png: has 15000 x 15000 pixels, more than 200,000,000" in message


def test_an_accessor_of_more_elements_than_the_file_can_hold_is_refused(folder: Path) -> None:
    accessors = [{"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}]
    text = json.dumps({"asset": {"version": "2.0"}, "accessors": accessors}).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    (folder / "a.glb").write_bytes(head + text)
    with pytest.raises(InputError, match="an accessor of 2,000,000,000 elements in a file of"):
        mesh_file.read_mesh(source(folder / "a.glb"))


def test_the_model_of_a_3mf_is_unpacked_and_nothing_else(folder: Path) -> None:
    with zipfile.ZipFile(folder / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", "<model/>")
        archive.writestr("Metadata/plate.png", bytes(10_000_000))
    with pytest.raises(InputError, match=r"a\.3mf: has no faces"):
        mesh_file.read_mesh(replace(source(folder / "a.3mf"), limits=Limits(model_bytes=1000)))


@pytest.mark.parametrize(
    ("text", "wild"),
    [
        ("#1=A(#2);#2147483647=B();", ""),
        ("#2147483648=ORIENTED_EDGE('',*,*,#1,.T.);", "#2147483648"),
        ("#1=A(#4294967296);", "#4294967296"),
        ("#1=A(#0);", "#0"),
        ("#1=A('#99999999999 is a text'); /* #99999999999 */", ""),
        (f"#{DIGITS}=A();", "#" + 24 * "9"),
        ("#0000000000012=A();", ""),
    ],
)
def test_numbers_of_step_entities_that_are_out_of_range_are_found(text: str, wild: str) -> None:
    assert find_wild_id(text.encode()) == wild


# -- the whole process: its output and its memory


def test_a_refusal_prints_no_warning_and_takes_little_memory(folder: Path) -> None:
    """The process may use 2 GB of address space."""
    (folder / "bomb.dxf").write_text(nested(10, 10))
    (folder / "page.svg").write_text(svg('<path d="M0 0h9"/><circle cx="1e308" cy="0" r="1e308"/>'))
    for name in ("bomb.dxf", "page.svg"):
        words = ["build", name, "--post", "gcode", "-q", "--set", "operation.kind=trace"]
        done = subprocess.run(
            [sys.executable, "-m", "camgen", *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000,) * 2),
        )
        assert "Warning" not in done.stderr
        assert done.returncode == (2 if name == "bomb.dxf" else 0)
        assert done.stderr.count("\n") == (1 if done.returncode else 0), done.stderr


def test_the_documents_hold_the_table_of_limits() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text(encoding="utf-8")
    assert format_limits() in page
