"""The operators of the mutants of code, and the judge of their programs, which can fail."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

from bench.reliability.code_mutants import targets
from bench.reliability.code_mutants.cases import BY_NAME, CASES, write_drawing
from bench.reliability.code_mutants.operators import OPERATORS, find_sites, mutate
from bench.reliability.code_mutants.survivors import is_found
from bench.reliability.code_mutants.targets import (
    CORE_GROUPS,
    PROGRAM_GROUPS,
    ROOT,
    Mutant,
    draw,
)
from bench.reliability.code_mutants.verdicts import find_fault
from camgen.pipeline import build
from tests.support.rs274 import needs_rs274


def _mutants(source: str, operator: str) -> list[str]:
    mutants = []
    for site in find_sites(source):
        if site.operator == operator:
            mutants.append(ast.unparse(mutate(source, site)))
    return mutants


@pytest.mark.parametrize(
    ("operator", "source", "expected"),
    [
        ("comparison", "a < b", ["a <= b", "a > b"]),
        ("arithmetic", "a + b", ["a - b"]),
        ("sign", "f(-a)", ["f(a)"]),
        ("arguments", "np.where(m, a, b)", ["np.where(m, b, a)"]),
        ("arguments", "min(a, b)", ["max(a, b)"]),
        ("index", "a[1:]", ["a[0:]", "a[2:]"]),
        ("constant", "f(2.0)", ["f(0)", "f(4.0)", "f(-2.0)"]),
        ("statement", "a = b", ["pass"]),
        ("condition", "a if b else c", ["a if not b else c"]),
        ("call", "f(a, b)", ["a"]),
        ("logic", "a and (not b)", ["a or not b", "a and b"]),
        ("element", "f((a, b, c))", ["f((b, c))", "f((a, c))", "f((a, b))"]),
    ],
)
def test_each_operator_makes_its_changes(operator: str, source: str, expected: list[str]) -> None:
    assert _mutants(source, operator) == expected


def test_text_that_no_build_runs_is_not_changed() -> None:
    source = (
        'from a import b\nif TYPE_CHECKING:\n    c = 1\ndef f(x: "A[1]") -> "B[2]":\n    "1 < 2"\n'
    )
    assert find_sites(source) == []
    assert {operator.name for operator in OPERATORS} == {
        "comparison", "arithmetic", "sign", "arguments", "index", "constant", "statement",
        "condition", "call", "logic", "element",
    }  # fmt: skip


def test_the_tests_of_a_folder_find_a_negated_condition() -> None:
    module = "camgen/geometry/apart.py"
    sites = find_sites((ROOT / module).read_text(encoding="utf-8"))
    negated = next(site for site in sites if site.operator == "condition")
    assert is_found(Mutant("geometry", module, negated))


def test_the_sites_of_a_module_are_the_same_each_time() -> None:
    source = (ROOT / "camgen/order/leads.py").read_text(encoding="utf-8")
    assert find_sites(source) == find_sites(source) != []


def test_the_draw_is_the_same_each_time_and_every_mutant_compiles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(targets, "find_sites", cache(find_sites))
    for groups, count in ((PROGRAM_GROUPS, 20), (CORE_GROUPS, 20)):
        mutants = draw(groups, count)
        assert mutants == draw(groups, count)
        assert {mutant.group for mutant in mutants} == set(groups)
        for mutant in mutants:
            compile(mutate(mutant.source, mutant.site), mutant.module, "exec")


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The program of each job."""
    folder = tmp_path_factory.mktemp("drawings")
    texts = {}
    for case in CASES:
        result = build(write_drawing(case, folder), post=case.post, job=case.job)
        texts[case.name] = "".join(file.text for file in result.files)
    return texts


@needs_rs274
@pytest.mark.parametrize("name", list(BY_NAME))
def test_the_program_of_every_job_is_right(name: str, programs: dict[str, str]) -> None:
    assert find_fault(BY_NAME[name], programs[name]) == ""


#: A job, a part of its program, the text in its place, and a part of the verdict.
FAULTS = [
    ("leads", "SetDO doProcess,1;", "", "work with the signal off"),
    ("leads", ":=[12.5,500", ":=[12.6,500", "12.6 mm/s, not 12.5 mm/s"),
    ("leads", "[310.000,-40.000,120.000]", "[310.000,40.000,120.000]", "frames"),
    ("leads", "[0.0000000,1.0000000,0.0000000,0.0000000]", "[1,0,0,0]", "the tool axis"),
    ("leads", "        c2;\n", "", "run 0 times"),
    ("leads", "        c2;\n", "        c2;\n        c2;\n", "run 2 times"),
    ("conventional", "TRANS(63,32,0,", "TRANS(63.1,32,0,", "leaves its curve"),
    ("conventional", "WAIT.EVENT , 0.25", "WAIT.EVENT , 0.5", "waits 0.5 s, not 0.25 s"),
    ("passes", "G1 Z-3 F300", "G1 Z-3.1 F300", "a pass at -3.100"),
    ("passes", "S8000 M3", "S4000 M3", "the job has another spindle speed"),
    ("passes", "G0 Z2\n", "", "without stopping at the approach height"),
    ("passes", "Z15", "Z14", "below the clearance height"),
    ("tabs", "Z-2.5\n", "Z-2\n", "a slope of 53.1 deg"),
    ("tabs", "F300", "F900", "15 mm/s, not plunge 5 mm/s"),
    ("lines", "L, @0 P(40.000, 10.000, 0.000", "L, @0 P(40.000, 10.200, 0.000", "from every line"),
    ("lines", "ChangeTool 1", "ChangeTool 2", "not with tool 1"),
    ("open passes", "Z-0.5", "Z-0.6", "a pass at -0.600"),
    ("network", "TRANS(60,10,0,", "TRANS(60,9,0,", "from every line"),
    ("pecks", "G1 Z-4 F1200", "G1 Z-3 F1200", "3.000 mm deep, not 4 mm"),
    ("pecks", "X20 Y25", "X20.1 Y25", "drills where there is no hole"),
    ("holes", "\n    Set IO[24]", "", "work with the signal off"),
    ("pocket", "G1 Z-2", "G1 Z-1.5", "a pass at -1.500"),
    ("pocket", "G1 Y17", "G1 Y17.1", "cuts 0.100 mm into the wall"),
    ("pressing", "vCam12_5,5,", "vCam12_5,6,", "a force of 6 N, not 5 N"),
    ("stay down", "        SetDO doProcess,1;\n", "", "20 mm/s, not travel 90 mm/s"),
    ("two tools", "S9000 M3", "S7000 M3", "spindle speeds"),
]


@needs_rs274
@pytest.mark.parametrize(("name", "part", "replacement", "fault"), FAULTS)
def test_the_judge_finds_faults(
    name: str, part: str, replacement: str, fault: str, programs: dict[str, str]
) -> None:
    assert part in programs[name]
    text = programs[name].replace(part, replacement)
    assert fault in find_fault(BY_NAME[name], text)


def test_the_judge_imports_nothing_of_camgen() -> None:
    folder = Path(__file__).parents[2] / "bench" / "reliability" / "code_mutants"
    for name in ("cases", "shapes", "traces", "judge", "contours", "verdicts"):
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                assert node.module is not None
                assert node.module.split(".")[0] not in ("camgen", "camgen_posts")
