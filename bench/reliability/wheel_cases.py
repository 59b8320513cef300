"""Builds every fixture with the wheel alone, and compares the golden programs.

    python -I wheel_cases.py FIXTURES

The interpreter of an empty environment runs it (`wheel`). Prints one line of JSON: the version, the
packages, the number of parts that the command line builds, the errors of the others, the number of
golden programs that are the same, and the names of the others. Imports camgen and the standard
library only.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import camgen

#: The posts by the suffixes of their programs.
POSTS = {".mod": "rapid", ".pcs": "pacscript", ".v2": "vplus", ".ngc": "gcode", ".nc": "grbl"}
SUFFIXES = (".stl", ".dxf", ".svg", ".png", ".xyz")


def make_job(case: Path, post: str) -> dict[str, dict[str, object]]:
    """The job of a golden case for a post."""
    job = tomllib.loads((case / "job.toml").read_text())
    if (case / "posts.toml").exists():
        job["post"] = tomllib.loads((case / "posts.toml").read_text()).get(post, {})
    if (case / "robots.toml").exists():
        job["cell"]["robot"] = tomllib.loads((case / "robots.toml").read_text()).get(post, "")
    return job


def compare(case: Path, parts: Path) -> tuple[int, list[str]]:
    """Builds the golden programs of a case: the number of equal ones, and the names of others."""
    name = case.name.split("-")[0]
    part = next(parts / (name + end) for end in SUFFIXES if (parts / (name + end)).exists())
    same, wrong = 0, []
    for post in sorted({POSTS.get(file.suffix, "") for file in (case / "expected").iterdir()}):
        if not post:
            continue
        for file in camgen.build(part, post=post, job=make_job(case, post), name="part").files:
            if file.text.splitlines() == (case / "expected" / file.name).read_text().splitlines():
                same += 1
            else:
                wrong.append(f"{case.name}/{file.name}")
    return same, wrong


def build(parts: Path) -> tuple[int, list[str]]:
    """Builds all parts in an empty folder: the number of programs, and the errors of the others."""
    program = Path(sys.executable).with_name("camgen")
    built, refused = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for part in sorted(parts.iterdir()):
            if part.suffix == ".toml" or "_base" in part.name:
                continue
            command = [program, "build", part, "--post", "rapid", "-q"]
            if part.suffix == ".png":
                command += ["--set", "image.mm_per_px=0.1"]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            built += done.returncode == 0
            if done.returncode:
                refused.append(f"{part.name}: {done.stderr.strip().splitlines()[-1]}")
        if len(list(Path(folder).iterdir())) < built:
            refused.append("a build ended with 0 and wrote nothing")
    return built, refused


def main() -> None:
    """Prints the line of JSON."""
    fixtures = Path(sys.argv[1])
    if not Path(camgen.__file__).is_relative_to(sys.prefix):
        sys.exit(f"camgen is not that of the environment: {camgen.__file__}")
    built, refused = build(fixtures / "parts")
    same, wrong = 0, []
    for case in sorted((fixtures / "cases").iterdir()):
        if case.is_dir():
            count, others = compare(case, fixtures / "parts")
            same += count
            wrong += others
    version = ".".join(map(str, sys.version_info[:3]))
    packages = sorted({package.name for package in distributions()} - {"pip", "setuptools"})
    print(json.dumps([version, packages, built, refused, same, wrong]))


if __name__ == "__main__":
    main()
