"""The wheel in an empty environment of each Python: every fixture built, and the same programs.

    python -m bench.reliability.wheel [PYTHON ...]

Makes the wheel, and for each PYTHON (default: python3.11 to python3.14, as far as they are
installed) a virtual environment with the wheel and its dependencies alone. `wheel_cases` builds
every part of fixtures/parts in it by the command line from an empty folder, and makes every golden
program again. STEP must be refused with a line that names its extra. Needs a package index. Prints
a table for docs/reliability.md, and exits with 1 if a program differs or a build fails.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.support.runner import ROOT, open_table
from bench.support.timing import measure_process, timed

PARTS_OF_WHEEL = ("camgen", "postprocessors", "pyproject.toml", "README.md", "LICENSE")
PYTHONS = tuple(f"python3.{minor}" for minor in range(11, 15))
_EXTRA = "pip install '.[step]'"


def _run(*words: str | Path) -> str:
    """The output of a command. SystemExit if it fails."""
    return measure_process(list(map(str, words))).text


def make_wheel(folder: Path) -> Path:
    """Makes the wheel from a copy, since setuptools writes folders beside its sources."""
    source = folder / "source"
    source.mkdir()
    for name in PARTS_OF_WHEEL:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, source / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source / name)
    _run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, source)
    return next(folder.glob("*.whl"))


def find_pythons() -> list[str]:
    """The `PYTHONS` that start: a name may belong to a version that is not installed."""
    starting = []
    for path in filter(None, map(shutil.which, PYTHONS)):
        if subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode == 0:
            starting.append(path)
    return starting


def measure(python: str, wheel: Path, folder: Path) -> tuple[list[object], list[str]]:
    """The row of a Python, and its faults.

    folder: takes the environment; its other files do not count.
    """
    environment = Path(tempfile.mkdtemp(dir=folder))
    _run(python, "-m", "venv", environment)
    _, seconds = timed(lambda: _run(environment / "bin" / "pip", "install", "-q", wheel))
    script = Path(__file__).with_name("wheel_cases.py")
    text = _run(environment / "bin" / "python", "-I", script, ROOT / "fixtures")
    version, packages, built, refused, same, wrong = json.loads(text.splitlines()[-1])
    extra = [line for line in refused if _EXTRA in line]
    row = [version, len(packages), seconds, built, len(extra), same, len(wrong)]
    return row, [*wrong, *(line for line in refused if line not in extra)]


def main(pythons: list[str]) -> int:
    """Prints the table. Returns 1 if a program differs or a build fails."""
    table = open_table(
        "Python | packages | s to install {:.0f} | parts built | refused for an extra "
        "| programs the same | others"
    )
    faults: list[str] = []
    chosen = pythons or find_pythons()
    with tempfile.TemporaryDirectory() as text:
        wheel = make_wheel(Path(text))
        for python in chosen:
            row, wrong = measure(python, wheel, Path(text))
            table.add(*row)
            faults += wrong
    for fault in faults:
        print(fault)
    return int(bool(faults) or not chosen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
