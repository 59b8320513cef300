"""Processors must not show in the bytes: goldens and pictures are made again without AVX-512.

numpy has sines, arc tangents and exponentials of its own for AVX-512. Their last bit differs from
that of the common ones, and so does the last bit of a product of OpenBLAS.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.waiting import LONG

ROOT = Path(__file__).parents[1]
GOLDENS = ("tests/test_cases.py", "tests/docs/test_docs.py::test_pictures_are_current")
#: Cases in which the last bit of a coordinate differs between processors, and a part at an arm.
CASES = ("pocket", "motor-plate", "smooth-passes", "space", "rfa1-edges", "seam-trace")
#: The longest case is printed for two controllers only. The other cases are printed for all.
LEFT_OUT = [f"motor-plate-{post}" for post in ("vplus", "pacscript", "grbl")]
LIST_AVX512 = "from tests.test_processors import list_avx512; print(list_avx512())"


def list_avx512() -> list[str]:
    """The features of AVX-512 that numpy finds in the processor and has not switched off."""
    config: Any = np.show_config(mode="dicts")
    features = config["SIMD Extensions"]["found"]
    return [name for name in features if name == "X86_V4" or name.startswith("AVX512")]


def run_without_avx512(*words: str) -> str:
    """Call Python with ``words`` and return the text that it prints. It must end with code 0."""
    environment = {
        **os.environ,
        "NPY_DISABLE_CPU_FEATURES": " ".join(list_avx512()),
        "OPENBLAS_CORETYPE": "Haswell",
    }
    command = [sys.executable, *words]
    process = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=LONG,
    )
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


@pytest.mark.skipif(not list_avx512(), reason="numpy finds no AVX-512 that could be switched off")
def test_goldens_and_pictures_are_the_same_without_avx512() -> None:
    assert run_without_avx512("-c", LIST_AVX512) == "[]\n"
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    chosen = f"({' or '.join(CASES)}) and not ({' or '.join(LEFT_OUT)})"
    run_without_avx512(*words, *GOLDENS, "-k", chosen)
