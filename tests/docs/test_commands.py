"""Runs the commands of README and documents, on files with their names, and the examples in Python.

`test_docs.py` parses commands whose files are words in capitals, and runs commands that are shown
with their output by `docs.make.pages`.
"""

import itertools
import re
import shlex
import shutil
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import cv2
import ezdxf
import numpy as np
import pytest
import trimesh
from ezdxf import recover

from bench.render import photos
from bench.render.burrs import add_burrs
from bench.render.parts import paper
from camgen.cli import main, make_parsers
from camgen.model.errors import JobError
from docs.make.pages import CONSOLES
from tests.docs.test_docs import FILES, ROOT, USAGE, list_commands, name
from tests.support.benches import open_bench
from tests.support.clouds import scan
from tests.support.old_programs import PACSCRIPT, RAPID, VPLUS

FIXTURES = ROOT / "fixtures"
PARTS = FIXTURES / "parts"
#: Files that the documents name, and the files of which they are copies.
COPIES = {
    **dict.fromkeys(("part.dxf", "-part.dxf", "drawing.dxf", "bracket.dxf"), PARTS / "bracket.dxf"),
    **{f"parts/{k}.dxf": PARTS / f"{k}.dxf" for k in ("bracket", "plate")},
    **{
        file: PARTS / file
        for file in (
            "logo.svg",
            "copper.dxf",
            "gear.png",
            "rfa1.stl",
            "rfa1.toml",
            "rfa1_base.stl",
            "space.dxf",
            "seam.xyz",
        )
    },
    **dict.fromkeys(("fixtures/parts/bracket.dxf",), PARTS / "bracket.dxf"),
    "board.png": PARTS / "board.png",
    "motor.dxf": PARTS / "motor.dxf",
    "motor.toml": FIXTURES / "cases" / "motor-plate" / "job.toml",
    "plate.dxf": PARTS / "plate.dxf",
    "part.svg": PARTS / "logo.svg",
    "arm.urdf": FIXTURES / "robots" / "six.urdf",
    **{file: FIXTURES / "machines" / file for file in ("router.txt", "mill.ini")},
}
#: A part of each complete command that cannot be run in this test, and the reason.
NOT_RUN = {
    "tcp://host:8786": "needs a cluster, see tests/batch/test_batch_dask.py",
    "--post krl": "needs the example post installed, see tests/docs/test_writing_a_post.py",
    "verify bracket.src": "needs it too, see tests/docs/test_writing_a_post.py",
    "slot.xy": "needs the example reader installed, see tests/read/test_example_reader.py",
    "place rfa1.stl": "a search of half a minute, which is run on part.stl, a part of few edges",
    "--job place-2.toml": "needs the files of camgen place, see tests/cli/test_place.py",
    "one.mod par": "a line that a shell completes, see tests/cli/test_completion.py",
    "capture 0": "needs a camera, see tests/cli/test_capture.py",
    "build camera:0": "needs a camera, see tests/cli/test_capture.py",
    "init motor.dxf": "motor.toml is there already, see tests/cli/test_init.py",
    "verify part_2.nc": "needs several programs and their plan, see tests/cli/test_header.py",
    "inspect camera:0": "needs a camera, see tests/cli/test_capture.py",
}


#: A job file on a page: a paragraph that starts with its name, then the block.
JOB_FILE = re.compile(r"^`(\w+\.toml)`:.*?^```toml\n(.*?)^```", re.S | re.M)
BLOCK = re.compile(r"^```python\n(.*?)^```", re.S | re.M)
CONSOLE = re.compile(r"^```console\n.*?^```", re.S | re.M)
MODULE = re.compile(r"python -m ((?:bench|docs|camgen)[\w.]*\w)")
#: Corners of the part.stl of the documents, mm. It has few edges of different lengths; three of
#: them are on top.
WEDGE = [(20, 20, 60), (110, 20, 60), (20, 90, 60), (40, 35, 0)]
OLD = "G21 G90\nG0 X0 Y0 Z10\nG1 Z0 F300\nG2 X20 I10 J0\nG1 X0\nG0 Z10\nM2\n"
DRILL = "o<drill> sub\nG21 G0 X#1 Y#2\nG0 Z5\nG1 Z[-#3] F100\no<drill> endsub\n"
SUB = "O9000\nG1 X5 F100\nM99\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2000\n"
    + "".join(f"property float {k}\n" for k in "xyz")
    + "end_header"
)


class ShownCommand(NamedTuple):
    """A command of a page. jobs: name and text of each job file on this page."""

    line: str
    jobs: tuple[tuple[str, str], ...]


def list_complete_commands() -> dict[ShownCommand, str]:
    """The complete commands of the documents, each with the first page that shows it."""
    first_pages: dict[ShownCommand, str] = {}
    parser, _ = make_parsers()
    for page in FILES:
        text = page.read_text(encoding="utf-8")
        if page.name in CONSOLES:
            text = CONSOLE.sub("", text)
        for line, _ in list_commands(text):
            if USAGE.search(line) or any(part in line for part in NOT_RUN):
                continue
            # --version prints and exits.
            with suppress(SystemExit), redirect_stdout(StringIO()):
                try:
                    parser.parse_args(split_words(line))
                except JobError:
                    # A mention such as `camgen build`. test_docs.py finds lines that are wrong.
                    continue
            first_pages.setdefault(ShownCommand(line, tuple(JOB_FILE.findall(text))), name(page))
    return first_pages


def split_words(line: str) -> list[str]:
    return shlex.split(line.partition(" > ")[0], comments=True)[1:]


def write_video(file: Path, photo: np.ndarray) -> None:
    """Writes a lossless video of three frames of a photo."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"FFV1"), 10.0, photo.shape[1::-1])
    for _ in range(3):
        writer.write(photo)
    writer.release()


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the documents name."""
    folder = tmp_path_factory.mktemp("desk")
    for file, source in COPIES.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, folder / file)
    board = ezdxf.new("R2010", units=4)
    for k in range(4):
        board.modelspace().add_circle((5.0 * k, 0), 0.4)
    board.saveas(folder / "board.dxf")
    photo = photos.photos(1, 1)[0]
    even_shot = replace(
        photo.shot, lens=replace(photo.shot.lens, size=(1200, 858))
    )  # as codecs want it
    # The part has a burr, so that a second pass has work.
    burred_loops, _ = add_burrs(photo.loops, 1, np.random.default_rng(1), 1.2, 1.5, (6.0, 8.0))
    layers = (*photo.scene.layers[:-1], replace(photo.scene.layers[-1], loops=burred_loops))
    burred = replace(photo, loops=burred_loops, scene=replace(photo.scene, layers=layers))
    photos.write(folder, replace(burred, name="photo", shot=even_shot))
    sheet = ezdxf.new("R2010", units=4)
    (loop,) = paper()
    rows = [(z.real, z.imag, bulge) for z, bulge in zip(loop.points, loop.bulges, strict=True)]
    sheet.modelspace().add_lwpolyline(rows, format="xyb", close=True)
    sheet.saveas(folder / "sheet.dxf")
    write_video(folder / "clip.avi", cv2.imread(str(folder / "photo.png")))
    wedge = trimesh.Trimesh(WEDGE, [(0, 1, 2), (1, 0, 3), (2, 1, 3), (0, 2, 3)])
    wedge.export(folder / "part.stl")
    np.savetxt(folder / "bench.ply", scan(wedge, 2000, 1), fmt="%.4f", header=PLY, comments="")
    texts = {
        "old.ngc": OLD,
        "old.nc": OLD,
        "sub.nc": SUB,
        "drill.ngc": DRILL,
        "glue.mod": RAPID,
        "square.v2": VPLUS,
        "old.pcs": PACSCRIPT,
    }
    (folder / "programs").mkdir(exist_ok=True)
    for file, text in (texts | {"old.v2": VPLUS, "programs/old.ngc": OLD}).items():
        (folder / file).write_text(text)
    clamped, _ = recover.readfile(PARTS / "motor.dxf")
    for x, y in itertools.product((-20, 116), (-20, 86)):
        corners = [(x, y), (x + 24, y), (x + 24, y + 24), (x, y + 24)]
        clamped.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": "CLAMPS"})
    clamped.saveas(folder / "clamped.dxf")
    (folder / "frame.toml").write_text("[cell]\nbase_from_work = [400, 0, 100, 0, 0, 0]\n")
    words = [str(folder / "part.dxf"), "--post", "rapid", "--plan", str(folder / "part.json"), "-q"]
    assert main(["build", *words, "-o", str(folder)]) == 0
    milled = (
        "operation.depth=5.0",
        "operation.passes=2",
        "tool.diameter=3.0",
        "process.spindle=9000.0",
    )
    words = [str(folder / "plate.dxf"), "--post", "gcode", "-q", "-o", str(folder)]
    assert main(["build", *words, *(f"--set={setting}" for setting in milled)]) == 0
    return folder


@pytest.mark.parametrize("shown", list_complete_commands(), ids=lambda shown: shown.line)
def test_a_command_runs(
    shown: ShownCommand, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    shutil.copytree(desk, folder)
    for file, text in shown.jobs:
        (folder / file).write_text(text)
    monkeypatch.chdir(folder)
    words = split_words(shown.line)
    if words[0] == "open":  # The workbench runs until it is closed.
        with open_bench(folder, words[1:]) as bench:
            assert bench.wait()["failed"] is None
        return
    assert main(words) == 0
    for option, file in itertools.pairwise(words):
        if option in ("-o", "--preview", "--plan"):
            assert Path(file).exists(), file


def list_examples(page: Path) -> list[str]:
    """The blocks of Python that run. The blocks of the API page are signatures."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [block for block in blocks if not block.startswith(("def ", "class ", "@"))]


@pytest.mark.parametrize("page", [page for page in FILES if list_examples(page)], ids=name)
def test_examples_in_python_run(
    page: Path, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blocks of a page run one after another, with common names."""
    shutil.copytree(desk, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.syspath_prepend(ROOT / "docs" / "example_post")
    names: dict[str, object] = {"__name__": "example"}
    for block in list_examples(page):
        exec(compile(block, str(page), "exec"), names)


def test_commands_of_the_repository_exist() -> None:
    pages = [*FILES, ROOT / "bench" / "README.md"]
    named: set[str] = set()
    for page in pages:
        named.update(MODULE.findall(page.read_text(encoding="utf-8")))
    assert len(named) > 20
    assert not [module for module in sorted(named) if find_spec(module) is None]


def test_a_complete_command_is_distinguished_from_a_mention() -> None:
    lines = {shown.line for shown in list_complete_commands()}
    assert len(lines) > 30
    assert "camgen build part.dxf --post rapid" in lines
    assert not lines & {"camgen build", "camgen verify", "camgen build INPUT... --post NAME"}
