"""What README and documents show runs: commands on files of the names they use, and examples in Python.

Commands whose files are words in capitals are only parsed, those with what they print are run by
``docs.make.pages``; both in ``test_docs.py``.
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
from tests.docs.test_docs import FILES, ROOT, USAGE, commands, name
from tests.support.benches import open_bench
from tests.support.clouds import scan
from tests.support.old_programs import PACSCRIPT, RAPID, VPLUS

FIXTURES = ROOT / "fixtures"
PARTS = FIXTURES / "parts"
#: Files that the documents speak of, by what they are made from.
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
#: Why a command that is whole cannot be run here.
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


#: A job file as a page shows it: its name at the beginning of a paragraph, then the block.
JOB_FILE = re.compile(r"^`(\w+\.toml)`:.*?^```toml\n(.*?)^```", re.S | re.M)
BLOCK = re.compile(r"^```python\n(.*?)^```", re.S | re.M)
CONSOLE = re.compile(r"^```console\n.*?^```", re.S | re.M)
MODULE = re.compile(r"python -m ((?:bench|docs|camgen)[\w.]*\w)")
#: Corners of the part.stl of the documents, mm: few edges, no two alike, three of them on top.
WEDGE = [(20, 20, 60), (110, 20, 60), (20, 90, 60), (40, 35, 0)]
OLD = "G21 G90\nG0 X0 Y0 Z10\nG1 Z0 F300\nG2 X20 I10 J0\nG1 X0\nG0 Z10\nM2\n"
DRILL = "o<drill> sub\nG21 G0 X#1 Y#2\nG0 Z5\nG1 Z[-#3] F100\no<drill> endsub\n"
SUB = "O9000\nG1 X5 F100\nM99\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2000\n"
    + "".join(f"property float {k}\n" for k in "xyz")
    + "end_header"
)


class Shown(NamedTuple):
    """A command, and the job files that its page has for it."""

    line: str
    jobs: tuple[tuple[str, str], ...]


def whole_commands() -> dict[Shown, str]:
    """Every command of the documents that stands with all it needs, once, with the first page that shows it."""
    found: dict[Shown, str] = {}
    parser, _ = make_parsers()
    for page in FILES:
        text = page.read_text(encoding="utf-8")
        if page.name in CONSOLES:
            text = CONSOLE.sub("", text)
        for line, _ in commands(text):
            if USAGE.search(line) or any(why in line for why in NOT_RUN):
                continue
            with suppress(SystemExit), redirect_stdout(StringIO()):  # --version prints and leaves
                try:
                    parser.parse_args(words_of(line))
                except (
                    JobError
                ):  # spoken of, such as `camgen build`; test_docs.py says where a line is wrong
                    continue
            found.setdefault(Shown(line, tuple(JOB_FILE.findall(text))), name(page))
    return found


def words_of(line: str) -> list[str]:
    return shlex.split(line.partition(" > ")[0], comments=True)[1:]


def film(file: Path, photo: np.ndarray) -> None:
    """Three frames of a photo, with every pixel as it is."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"FFV1"), 10.0, photo.shape[1::-1])
    for _ in range(3):
        writer.write(photo)
    writer.release()


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the documents speak of."""
    folder = tmp_path_factory.mktemp("desk")
    for file, source in COPIES.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, folder / file)
    board = ezdxf.new("R2010", units=4)
    for k in range(4):
        board.modelspace().add_circle((5.0 * k, 0), 0.4)
    board.saveas(folder / "board.dxf")
    photo = photos.photos(1, 1)[0]
    even = replace(photo.shot, lens=replace(photo.shot.lens, size=(1200, 858)))  # as codecs want it
    # A burr, so that there is something to work again.
    loops, _ = add_burrs(photo.loops, 1, np.random.default_rng(1), 1.2, 1.5, (6.0, 8.0))
    layers = (*photo.scene.layers[:-1], replace(photo.scene.layers[-1], loops=loops))
    burred = replace(photo, loops=loops, scene=replace(photo.scene, layers=layers))
    photos.write(folder, replace(burred, name="photo", shot=even))
    sheet = ezdxf.new("R2010", units=4)
    (loop,) = paper()
    rows = [(z.real, z.imag, bulge) for z, bulge in zip(loop.points, loop.bulges, strict=True)]
    sheet.modelspace().add_lwpolyline(rows, format="xyb", close=True)
    sheet.saveas(folder / "sheet.dxf")
    film(folder / "clip.avi", cv2.imread(str(folder / "photo.png")))
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
    sets = [word for one in milled for word in ("--set", one)]
    assert (
        main(
            ["build", str(folder / "plate.dxf"), "--post", "gcode", "-q", "-o", str(folder), *sets]
        )
        == 0
    )
    return folder


@pytest.mark.parametrize("shown", whole_commands(), ids=lambda shown: shown.line)
def test_a_command_runs(
    shown: Shown, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    shutil.copytree(desk, here)
    for file, text in shown.jobs:
        (here / file).write_text(text)
    monkeypatch.chdir(here)
    words = words_of(shown.line)
    if words[0] == "open":  # it stays until it is closed
        with open_bench(here, words[1:]) as bench:
            assert bench.wait()["failed"] is None
        return
    assert main(words) == 0
    for option, file in itertools.pairwise(words):
        if option in ("-o", "--preview", "--plan"):
            assert Path(file).exists(), file


def examples(page: Path) -> list[str]:
    """The blocks of Python that do something; those of the API page say how something is called."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [block for block in blocks if not block.startswith(("def ", "class ", "@"))]


@pytest.mark.parametrize("page", [page for page in FILES if examples(page)], ids=name)
def test_examples_in_python_run(
    page: Path, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one go, as a reader would type them."""
    shutil.copytree(desk, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.syspath_prepend(ROOT / "docs" / "example_post")
    names: dict[str, object] = {"__name__": "example"}
    for block in examples(page):
        exec(compile(block, str(page), "exec"), names)


def test_commands_of_the_repository_exist() -> None:
    pages = [*FILES, ROOT / "bench" / "README.md"]
    named = {
        module for page in pages for module in MODULE.findall(page.read_text(encoding="utf-8"))
    }
    assert len(named) > 20
    assert not [module for module in sorted(named) if find_spec(module) is None]


def test_a_whole_command_is_told_from_one_that_is_spoken_of() -> None:
    lines = {shown.line for shown in whole_commands()}
    assert len(lines) > 30
    assert "camgen build part.dxf --post rapid" in lines
    assert not lines & {"camgen build", "camgen verify", "camgen build INPUT... --post NAME"}
