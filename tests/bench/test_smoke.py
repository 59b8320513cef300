"""Each bench runs on its smallest input and prints its tables. Other tests check its numbers."""

import json
import os
import re
import runpy
import shlex
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import cv2
import pytest

from bench.photo.calibrate import CAMERA
from bench.render import photos
from bench.support.runner import machine
from tests.support.board_photos import chess, photo, poses
from tests.support.forks import start_process
from tests.support.plate import write_plate

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
PROGRAMS = ROOT / "fixtures" / "cases" / "bracket-follow" / "expected"
NUMBER = re.compile(r"-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?")
#: Benches that reliability.wheel runs with the interpreter of an empty environment.
NOT_FOR_USERS = {"reliability.wheel_cases"}
#: Benches that install packages from an index, which no test does. .ci/run runs them.
BY_CI = {"reliability.wheel"}


class Smoke(NamedTuple):
    """A short run of a bench, and its expected output.

    command: words after `python -m bench.`; `{here}` is the folder of small inputs.
    rows: number of rows of each table.
    within: range of all numbers in a column, by the name of the column.
    needs: reason why the bench cannot run, "" if it can.
    alone: whether it needs a process of its own.
    """

    command: str
    rows: tuple[int, ...]
    within: dict[str, tuple[float, float]]
    needs: str = ""
    alone: bool = False


def lacking(module: str = "", *programs: str) -> str:
    """The reason to skip a bench: a missing module or missing programs. "" without a reason."""
    if module and not find_spec(module):
        return f"{module} is not installed"
    if programs and not any(map(shutil.which, programs)):
        return f"{' or '.join(programs)} is not installed"
    return ""


BROWSERS = "chromium", "chromium-headless-shell"
FIGURES = {"max mm": (0.0, 1.0), "rms mm": (0.0, 0.6)}
SMOKES = [
    Smoke(
        "speed.processes help 251 --runs 1",
        (4,), {"median s": (0.01, 120), "peak MB": (5, 2000)},
    ),
    Smoke("speed.batch {here}/dxf 1 1 1", (4,), {"programs": (1, 1)}),
    Smoke(
        "speed.page 500 0.01 1", (4,), {"points of the program": (50, 20000)},
        lacking("playwright", *BROWSERS),
    ),
    # These benches fork, which is not allowed in a process with threads.
    Smoke("reliability.inputs 12 0 1", (12,), {"mutants": (1, 1), "misses": (0, 0)}, alone=True),
    Smoke(
        "reliability.fuzz 5 0 svg verify-grbl",
        (2,), {"misses": (0, 0), "examples": (5, 5)}, alone=True,
    ),
    Smoke(
        "reliability.combinations 1", (6,),
        {"cases": (0, 1), "other": (0, 0), "misses": (0, 0)}, alone=True,
    ),
    Smoke("reliability.kills 2 1", (2,), {"files damaged": (0, 0)}),
    Smoke(
        "workbench.kill 1", (2, 1), {"kills": (1, 1), "edits": (1, 4), "lost": (0, 0)},
        lacking("playwright", *BROWSERS), alone=True,
    ),
    Smoke(
        "tours.search 20", (3 if find_spec("numba") else 2,),
        {"paths": (20, 20), "travel, m": (0.15, 0.3), "bound, m": (0.1, 0.3)},
    ),
    Smoke(
        "tours.drawings {here}/dxf",
        (1,), {"paths": (9, 9), "as drawn": (150, 250), "default": (80, 150)},
    ),
    Smoke("tours.drawings million 50", (1,), {"segments": (500, 500), "chains": (50, 50)}),
    Smoke("plan.engagement shapes 2", (1,), {"above, mm": (0, 15), "m": (0.3, 3)}),
    Smoke("plan.adaptive {here}/none 'motor plate'", (1,), {"gouged mm2": (0, 0), "s": (100, 300)}),
    Smoke(
        "plan.pockets shapes 5", (1,), {"bare mm2": (0, 0), "gouged mm2": (0, 0), "paths": (4, 20)},
    ),
    Smoke(
        "plan.follow {here}/dxf/plate.dxf 3",
        (1,), {"paths": (7, 7), "working points off mm": (0, 0.02)},
    ),
    Smoke(
        "plan.proposals {here}/dxf 1", (1,), {"in operations %": (95, 100), "hours": (0.01, 2)},
        lacking("", "rs274"),
    ),
    Smoke(
        "plan.random_parts 4 0 1", (3,),
        {"dropped": (0, 0), "deepest gouge mm": (0, 0.011), "holes late": (0, 0)},
    ),
    Smoke(
        "plan.boards {here}/none 1 400", (4, 2),
        {"covered": (95, 100), "invented": (0, 0), "rms, px": (0, 0.2)},
    ),
    Smoke("plan.stops copper.dxf", (2,), {"strokes": (2, 17), "pen-down motions": (100, 400)}),
    Smoke("plan.drawing {here}/image", (1,), {"strokes": (8, 8), "off (px)": (0.1, 1.5)}),
    Smoke("robots.kinematics 20", (11,), {"found again": (100, 100), "mm": (0, 1e-3)}),
    Smoke(
        "robots.collision 20", (12,), {"differ from the plain loop": (0, 0), "poses/s": (1, 1e9)},
    ),
    Smoke("robots.rfa paper", (16, 21), {"mm": (8, 210), "s": (0.4, 20)}),
    Smoke(
        "robots.rfa 0 rfa1 'IRB 1200'", (3,),
        {"nominal": (12, 12), "stops": (0, 0), "collide": (0, 0)},
    ),
    Smoke("robots.coverage block", (1,), {"mm": (800, 900), "pieces": (8, 9)}, lacking("OCP")),
    Smoke("robots.set_ups block", (1,), {"two": (16, 16), "left of it": (0, 0)}, lacking("OCP")),
    Smoke("robots.reach_judge none", (0,), {}, lacking("py_opw_kinematics")),
    Smoke(
        "robots.robotsp made",
        (2,), {"not reached": (0, 0), "cost": (1, 12), "execution, s": (2, 15)},
    ),
    Smoke(
        "robots.parts {here}/solid 20", (2,), {"of these unfounded": (0, 0), "edges run": (1, 12)},
    ),
    Smoke("robots.urdfs {here}/none 'KR 10'", (1,), {}),
    Smoke("photo.lenses 1 0 'strong lens, 5 mm' flat", (1, 1), {"photos": (1, 1)}),
    Smoke("photo.masks {here}/image 480 1", (5,), {"parts": (1, 1), "holes": (7, 12)}),
    Smoke("photo.photo render {here}/new 1 1", (), {}),
    Smoke("photo.photo judge {here}/photos", (1, 3), {"built": (1, 1), "max mm": (0, 1)}),
    Smoke(
        "photo.photo speed {here}/photos paper-1mp 1",
        (4,), {"best s": (0.01, 120), "peak MB": (20, 2000)},
    ),
    Smoke("photo.pist --small", (4, 1, 2, 3), FIGURES),
    Smoke("photo.pist --feed --small", (2,), {"off 5 %": (0, 35), "peak": (0.9, 4)}),
    Smoke("photo.burrs 1 2 1", (1, 1), {"missed": (0, 0), "height off: max mm": (0, 0.3)}),
    Smoke("photo.conditions 1 0 0", (1,), {"rms mm": (0, 5)}),
    Smoke(
        "photo.deviations 1 0 burrs bracket", (1, 1),
        {"dangerous": (0, 0), "right": (1, 1), "% of all": (1, 60)},
    ),
    Smoke(
        "photo.pieces 1 4 noise notch", (2,),
        {"refused": (0, 1), "pieces drawn": (10, 60), "good": (0, 1)},
    ),
    Smoke(
        "photo.calibrate {here}/boards 9x6 1", (7, 4), {"fx": (599, 601), "**camgen**": (0, 0.1)},
    ),
    # LinuxCNC does not start reliably, and no test needs it.
    Smoke("controllers.linuxcnc layers-inside shapes --planned", (8,), {"predicted, s": (0.4, 7)}),
    Smoke("check.rounding gaps-outside", (3,), {"allowed, mm": (0.01, 0.02), "stops": (5, 20)}),
    Smoke("check.tangent_parts 3", (3,), {"parts": (1, 1), "beyond the tolerance": (0, 0)}),
    Smoke(
        "check.proof 1 11", (3,),
        {"%": (0.01, 90), "deepest gouge mm": (0, 0.005), "excess mm3": (0, 1)},
    ),
    Smoke("check.set_up {here}/dxf plate.dxf", (1,), {"false": (0, 0)}),
    Smoke(
        "check.set_up_faults 1 1 'depth in the job' 'outline with a gap' 'speed in the text'",
        (3,), {"no line": (0, 0), "seeded": (1, 1)},
    ),
    Smoke("check.fixture_faults 5", (5,), {"missed": (0, 0), "of these reported": (0, 0)}),
    Smoke(
        "check.mill_faults 1 1 'one tab taken away'", (1,), {"seeded": (1, 1), "missed": (0, 0)},
    ),
    Smoke("check.stock_faults 12", (13,), {"missed": (0, 0), "seeded": (1, 12)}),
    Smoke(
        "check.template {here}/dxf alone", (1, 1),
        {"gouge mm": (0, 0.005), "left unexplained mm2": (0, 0.01), "built": (1, 1),
         "miss a goal": (0, 0)},
    ),
    Smoke("check.harm {here}/faults", (1, 0), {"found": (1, 1), "faults": (1, 1)}),
    Smoke("languages.choose {here}/none", (7,), {"programs": (0, 0)}),
    Smoke("languages.strict_runs 200", (6,), {"lines": (2000, 9000)}),
    Smoke("languages.public {here}/none gcode", (1,), {"programs": (60, 60), "tracebacks": (0, 0)}),
    Smoke("languages.longest {here}/none", (0,), {}),
    Smoke("languages.coverage {here}/none", (0,), {}),
    Smoke("languages.verdicts {here}/none", (5, 0), {"programs": (25, 190), "examined": (0, 0)}),
    # These benches fork.
    Smoke(
        "reliability.mutants grbl --list --every 200", (8,),
        {"mutants": (10, 25), "caught": (8, 25), "left over": (0, 0)}, alone=True,
    ),
    Smoke(
        "reliability.code_mutants --count 2", (5,), {"mutants": (0, 1)},
        lacking("", "rs274"), alone=True,
    ),
    Smoke("reliability.code_mutants survivors --count 2", (), {}),
    Smoke("read.localize 1 1 2000 rfa1", (4,), {"found": (0, 1)}),
    # The search for a part that the scan does not show takes ten times as long.
    Smoke("read.one_sided 1 6000 1 - rfa1", (2,), {"runs": (1, 1), "right": (1, 1)}),
    Smoke("read.drawings {here}", (1,), {"used": (9, 9)}),
    Smoke(
        "read.dxf_numbers 29 1 4", (30, 8),
        {"silent": (0, 0), "with another note": (0, 0), "length off, ppm": (0, 200)},
    ),
    Smoke(
        "read.svg_geometry 1", (1,),
        {"drawings": (1, 1), "failed": (0, 0), "drawn": (6, 7), "silent": (0, 0)},
        lacking("playwright", *BROWSERS), alone=True,
    ),
    Smoke("read.edges {here}", (1,), {"convex mm (measured)": (1390, 1391)}),
    Smoke("read.scans 2 1", (1,), {"scans": (1, 1), "right": (1, 1)}),
    Smoke("read.meshes 0 54", (27,), {"meshes": (2, 2), "silent": (0, 0)}),
    Smoke("read.step_solids", (15,), {"right": (2, 2), "silent": (0, 0)}, lacking("OCP")),
    Smoke("read.old_gcode_words linuxcnc marlin", (2,), {"silent": (0, 0)}),
    Smoke("read.replay {programs}", (2,), {}, lacking("", "rs274")),
    Smoke("read.programs {programs}", (2,), {"stopped": (0, 0), "refused": (0, 0)}),
    Smoke("read.syntax gcode", (1,), {"differ": (0, 0)}),
    Smoke("read.syntax rapid", (1,), {"differ": (0, 0)}),
    Smoke("read.syntax vplus", (1,), {"differ": (0, 0)}),
    Smoke("read.syntax pacscript", (1,), {"differ": (0, 0)}),
    Smoke("read.old_words 1 moves pdispset letp", (6, 3), {"count": (0, 1), "silent": (0, 0)}),
    Smoke("read.translate layers-inside", (6, 14), {"mm apart": (0, 0.022), "s apart": (0, 0.01)}),
]  # fmt: skip


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small inputs: drawing, mesh, picture, their truth, photos, faulty programs."""
    folder = tmp_path_factory.mktemp("bench")
    for name, kind in (("plate.dxf", "dxf"), ("rfa1.stl", "mesh"), ("gear.png", "image")):
        (folder / kind).mkdir(exist_ok=True)
        shutil.copy(PARTS / name, folder / kind)
    (folder / "truth.jsonl").write_text(
        json.dumps({"file": "dxf/plate.dxf", "total_exact": 100.0}) + "\n"
    )
    (folder / "solid").mkdir()
    write_plate(folder / "solid")
    (folder / "photos").mkdir()
    photos.write(folder / "photos", photos.photos(1, 1)[0])
    (folder / "boards").mkdir()
    for k, pose in enumerate(poses(CAMERA, (200, 125), 3, seed=7, fill=0.6)):
        cv2.imwrite(
            str(folder / "boards" / f"{k}.png"), photo(CAMERA, chess(9, 6, 25), pose, seed=k).pixels
        )
    faults = folder / "faults" / "rapid"
    faults.mkdir(parents=True)
    sound = (PROGRAMS / "part.mod").read_text(encoding="utf-8")
    (faults / "sound.mod").write_text(sound, encoding="utf-8")
    before, _, after = sound.rpartition("        SetDO doProcess,0;\n")
    (faults / "lost.mod").write_text(before + after, encoding="utf-8")
    rows = "language\tfile\tfault\nrapid\tlost.mod\tthe last switch-off is lost\n"
    (faults.parent / "table.tsv").write_text(rows, encoding="utf-8")
    return folder


def run_module(module: str, words: list[str], files: tuple[Path, Path]) -> None:
    """Runs a bench in this process. files: take its output and its errors."""
    for number, file in enumerate(files, 1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
    os.chdir(ROOT)
    sys.argv = [module, *words]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def run_alone(module: str, words: list[str], folder: Path) -> str:
    """The output of a bench in a process of its own."""
    output, errors = folder / "output", folder / "errors"
    process = start_process(run_module, module, words, (output, errors))
    process.join()
    assert process.exitcode in (0, 1), errors.read_text()
    return output.read_text()


def run_bench(
    module: str,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> str:
    """The output of a bench. A smoke run may miss goals, for which the exit code is 1."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", [module, *words])
    # A bench may unset this variable. monkeypatch sets it to its value afterwards.
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "")
    monkeypatch.delitem(sys.modules, module, raising=False)
    code: object = 0
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code
    assert code in (None, 0, 1)
    return capsys.readouterr().out


def read_tables(text: str) -> list[tuple[list[str], list[list[str]]]]:
    """The head and the rows of each Markdown table in a text."""
    blocks = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        lines = [line.strip().strip("|").split("|") for line in block.splitlines()]
        head, rule, *rows = [list(map(str.strip, cells)) for cells in lines]
        assert set("".join(rule)) == {"-"}, block
        blocks.append((head, rows))
    return blocks


@pytest.mark.parametrize("smoke", SMOKES, ids=lambda smoke: smoke.command)
def test_a_bench_prints_its_tables(
    smoke: Smoke,
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if smoke.needs:
        pytest.skip(smoke.needs)
    module, *words = shlex.split(f"bench.{smoke.command.format(here=inputs, programs=PROGRAMS)}")
    if smoke.alone:
        text = run_alone(module, words, tmp_path)
    else:
        text = run_bench(module, words, monkeypatch, capsys)
    tables = read_tables(text)
    assert not tables or machine() in text
    assert tuple(len(rows) for _, rows in tables) == smoke.rows, text
    for head, rows in tables:
        assert all(len(row) == len(head) for row in rows), text
    for column, (lowest, highest) in smoke.within.items():
        numbers: list[float] = []
        for head, rows in tables:
            cells = [row[head.index(column)] for row in rows] if column in head else []
            matches = filter(None, map(NUMBER.search, cells))
            numbers += [float(match[0].replace(",", "")) for match in matches]
        assert numbers, f"{column}: {text}"
        assert all(lowest <= number <= highest for number in numbers), f"{column}: {text}"


def test_each_bench_has_a_smoke_run_and_a_line_in_the_readme() -> None:
    commands = {
        ".".join(p.relative_to(ROOT / "bench").with_suffix("").parts).removesuffix(".__main__")
        for p in (ROOT / "bench").rglob("*.py")
        if '__name__ == "__main__"' in p.read_text(encoding="utf-8")
    } - NOT_FOR_USERS
    assert {smoke.command.split()[0] for smoke in SMOKES} | BY_CI == commands
    readme = (ROOT / "bench" / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"python -m bench\.([\w.]+)", readme)) == commands


def test_ci_runs_the_benches_that_need_an_index() -> None:
    lines = (ROOT / ".ci" / "run").read_text()
    assert all(f"-m bench.{name}" in lines for name in BY_CI)
