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
    """The folder with ``package`` installed, for PYTHONPATH. Skips where there is no setuptools."""
    if importlib.util.find_spec("setuptools") is None:
        pytest.skip("setuptools, which builds the example package, is not installed")
    source, target = folder / "source" / package.name, folder / "site"
    shutil.copytree(package, source, ignore=shutil.ignore_patterns("__pycache__"))
    target.mkdir()
    recent = tuple(int(n) for n in version("setuptools").split(".")[:2]) >= (70, 1)
    if recent or importlib.util.find_spec("wheel"):
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
        # setuptools before 70.1 needs the package wheel for pip; its own commands install the same files.
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
    """Python with what is installed in ``site``."""
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
