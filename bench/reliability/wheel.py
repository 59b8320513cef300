"""The wheel in an empty environment of every Python that is there: does it build every fixture, to the same programs?

    python -m bench.reliability.wheel [PYTHON ...]

Makes the wheel, and for each PYTHON (default: python3.11 to python3.14, those that are found) a virtual environment
with nothing but the wheel and what it declares. In it every part of fixtures/parts is built by the command line from an
empty folder, and every golden program is made again (``wheel_cases``). STEP must be refused with a line that names its
extra. Needs a package index. Prints a table for docs/reliability.md; exits with 1 where something differs or fails.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.support.runner import ROOT, open_table
from bench.support.timing import timed

PARTS_OF_WHEEL = ("camgen", "postprocessors", "pyproject.toml", "README.md", "LICENSE")
PYTHONS = tuple(f"python3.{minor}" for minor in range(11, 15))
_EXTRA = "pip install '.[step]'"


def _run(*words: str | Path, cwd: Path | None = None) -> str:
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def make_wheel(folder: Path) -> Path:
    """The wheel, made of a copy: setuptools leaves its own folders beside what it builds."""
    source = folder / "source"
    source.mkdir()
    for name in PARTS_OF_WHEEL:
        if (ROOT / name).is_dir():
            shutil.copytree(
                ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__")
            )
        else:
            shutil.copy(ROOT / name, source / name)
    _run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, source)
    return next(folder.glob("*.whl"))


def find_pythons() -> list[str]:
    """Those of PYTHONS that answer: a name may be there for a version that is not."""
    found = [path for path in map(shutil.which, PYTHONS) if path]
    return [
        path
        for path in found
        if not subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode
    ]


def look(python: str, wheel: Path, folder: Path) -> tuple[list[object], list[str]]:
    """A row of the table, and what went wrong."""
    where = folder / f"environment-{len(list(folder.glob('environment-*')))}"
    _run(python, "-m", "venv", where)
    _, seconds = timed(lambda: _run(where / "bin" / "pip", "install", "-q", wheel))
    script = Path(__file__).with_name("wheel_cases.py")
    text = _run(where / "bin" / "python", "-I", script, ROOT / "fixtures", cwd=folder)
    version, packages, built, refused, same, wrong = json.loads(text.splitlines()[-1])
    extra = [line for line in refused if _EXTRA in line]
    row = [version, len(packages), seconds, built, len(extra), same, len(wrong)]
    return row, [*wrong, *(line for line in refused if line not in extra)]


def main(pythons: list[str]) -> int:
    """The table; 1 where anything differs."""
    found = pythons or find_pythons()
    table = open_table(
        "Python | packages | s to install {:.0f} | parts built | refused for an extra "
        "| programs the same | others"
    )
    failed: list[str] = []
    with tempfile.TemporaryDirectory() as text:
        wheel = make_wheel(Path(text))
        for python in found:
            row, wrong = look(python, wheel, Path(text))
            table.add(*row)
            failed += wrong
    print("".join(f"\n{line}" for line in failed), end="\n" if failed else "")
    return 1 if failed or not found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
