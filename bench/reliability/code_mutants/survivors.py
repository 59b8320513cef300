"""Mutants of core modules that the tests of their folder do not find.

A survivor has to be in `survivors.tsv`, with the reason why no test can see it.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

from bench.reliability.code_mutants.running import module_name
from bench.reliability.code_mutants.targets import ROOT, Mutant

TABLE = Path(__file__).with_name("survivors.tsv")
#: Variable of the environment by which `plugin` knows its mutant.
VARIABLE = "CAMGEN_MUTANT"
#: The folder of the tests of each group.
_TESTS = {
    "geometry": "tests/geometry",
    "plan": "tests/plan",
    "order": "tests/order",
    "lower": "tests/lower",
    "stock": "tests/check/stock",
    "kinematics": "tests/robots",
}
#: Seconds after which tests count as failed: a mutant that never ends is found. They take 20 s.
_LONGEST_S = 600
_PROCESSES = 2


@cache
def list_tests(group: str, module: str) -> list[str]:
    """Test files of a group's folder that import a module or its package."""
    name = module_name(module)
    package = name.rpartition(".")[0]
    spellings = (f"from {name} import", f"from {package} import")
    naming = []
    for file in sorted((ROOT / _TESTS[group]).rglob("test_*.py")):
        text = file.read_text(encoding="utf-8")
        if any(spelling in text for spelling in spellings):
            naming.append(str(file.relative_to(ROOT)))
    return naming or [_TESTS[group]]


def is_found(mutant: Mutant) -> bool:
    """Whether a test fails with a mutant."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    command += ["-p", "bench.reliability.code_mutants.plugin"]
    command += list_tests(mutant.group, mutant.module)
    environment = {**os.environ, VARIABLE: json.dumps([mutant.module, mutant.site])}
    environment["PYTHONPATH"] = str(ROOT)
    try:
        result = subprocess.run(
            command,
            cwd=ROOT,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=_LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    return result.returncode != 0


def find_survivors(mutants: Sequence[Mutant]) -> Iterator[tuple[Mutant, bool]]:
    """Each mutant with whether it survives, in order."""
    with ThreadPoolExecutor(_PROCESSES) as pool:
        for mutant, is_caught in zip(mutants, pool.map(is_found, mutants), strict=True):
            yield mutant, not is_caught


def read_reasons() -> dict[tuple[str, str, str], str]:
    """The reason of each listed survivor, by module, code before and code after."""
    with TABLE.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE))
    return {(row["module"], row["before"], row["after"]): row["reason"] for row in rows}
