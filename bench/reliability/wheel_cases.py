"""Run by the interpreter of an empty environment, with nothing but the wheel in it: every fixture, compared.

    python -I wheel_cases.py FIXTURES

Prints one line of JSON: the version, the packages, how many parts were built and not built by the command line, how
many golden programs are the same and how many are not. Imports camgen and the standard library only.
"""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import camgen

#: The posts by the endings of their programs: which a case is for, its folder shows.
POSTS = {".mod": "rapid", ".pcs": "pacscript", ".v2": "vplus", ".ngc": "gcode", ".nc": "grbl"}
ENDINGS = (".stl", ".dxf", ".svg", ".png", ".xyz")


def compare(case: Path, parts: Path) -> tuple[int, list[str]]:
    """The golden programs of a case, built again: how many are the same, and those that are not."""
    base = case.name.split("-")[0]
    part = next(file for file in (parts / (base + ending) for ending in ENDINGS) if file.exists())
    same, wrong = 0, []
    for post in sorted(
        {POSTS[file.suffix] for file in (case / "expected").iterdir() if file.suffix in POSTS}
    ):
        job = tomllib.loads((case / "job.toml").read_text())
        for table, key in (("posts.toml", "post"), ("robots.toml", "robot")):
            if (case / table).exists():
                given = tomllib.loads((case / table).read_text())
                if key == "post":
                    job["post"] = given.get(post, {})
                else:
                    job["cell"]["robot"] = given.get(post, "")
        for file in camgen.build(part, post=post, job=job, name="part").files:
            if file.text.splitlines() == (case / "expected" / file.name).read_text().splitlines():
                same += 1
            else:
                wrong.append(f"{case.name}/{file.name}")
    return same, wrong


def build(parts: Path) -> tuple[int, list[str]]:
    """Every fixture by the command line, in an empty folder: how many programs, and what was said of the others."""
    built, refused = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for part in sorted(parts.iterdir()):
            if part.suffix == ".toml" or "_base" in part.name:
                continue
            command = [
                str(Path(sys.executable).with_name("camgen")),
                "build",
                str(part),
                "--post",
                "rapid",
                "-q",
            ]
            more = ["--set", "image.mm_per_px=0.1"] if part.suffix == ".png" else []
            done = subprocess.run(
                [*command, *more], cwd=folder, capture_output=True, text=True, check=False
            )
            built += done.returncode == 0
            if done.returncode:
                refused.append(f"{part.name}: {done.stderr.strip().splitlines()[-1]}")
        if len(os.listdir(folder)) < built:
            refused.append("a build ended with 0 and wrote nothing")
    return built, refused


def main() -> None:
    fixtures = Path(sys.argv[1])
    if not Path(camgen.__file__).is_relative_to(sys.prefix):
        sys.exit(f"camgen is not the one of the environment: {camgen.__file__}")
    built, refused = build(fixtures / "parts")
    same, wrong = 0, list[str]()
    for case in sorted(path for path in (fixtures / "cases").iterdir() if path.is_dir()):
        equal, other = compare(case, fixtures / "parts")
        same, wrong = same + equal, wrong + other
    version = ".".join(map(str, sys.version_info[:3]))
    packages = sorted({one.name for one in distributions()} - {"pip", "setuptools"})
    print(json.dumps([version, packages, built, refused, same, wrong]))


if __name__ == "__main__":
    main()
