"""Example packages of the documents, installed into a folder without network."""

import importlib.util
import os
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest


def install(package: Path, folder: Path) -> Path:
    """Installs a package into a folder for PYTHONPATH. The test is skipped without setuptools."""
    if importlib.util.find_spec("setuptools") is None:
        pytest.skip("setuptools, which builds the example package, is not installed")
    source, target = folder / "source" / package.name, folder / "site"
    shutil.copytree(package, source, ignore=shutil.ignore_patterns("__pycache__"))
    target.mkdir()
    is_recent = tuple(int(n) for n in version("setuptools").split(".")[:2]) >= (70, 1)
    if is_recent or importlib.util.find_spec("wheel"):
        pip = [
            "-m",
            "pip",
            "install",
            "-q",
            "--no-deps",
            "--no-build-isolation",
            "--no-index",
            "--target",
            str(target),
        ]
        command = [*pip, str(source)]
    else:
        # pip needs the package wheel for setuptools before 70.1. The commands of setuptools install
        # the same files.
        steps = ["-q", "build", "-b", str(source / "b"), "install_lib", "-d", str(target)]
        command = [
            "-c",
            "import setuptools; setuptools.setup()",
            *steps,
            "install_egg_info",
            "-d",
            str(target),
        ]
    subprocess.run([sys.executable, *command], cwd=source, check=True, capture_output=True)
    return target


def run(
    site: Path, *arguments: str, data: str = "", folder: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Runs Python with the packages in `site`. data: standard input."""
    environment = {**os.environ, "PYTHONPATH": str(site)}
    command = [sys.executable, *arguments]
    return subprocess.run(
        command,
        env=environment,
        input=data,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
