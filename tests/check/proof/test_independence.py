"""The proof of motion shares no code with what it proves."""

import ast
from pathlib import Path

import pytest

PROOF = Path(__file__).parents[3] / "camgen" / "check" / "proof"
#: Values, and two tables of a reader: names of colors and sizes of units.
ALLOWED = ("camgen.model.", "camgen.check.proof", "camgen.read.colors", "camgen.read.units")


@pytest.mark.parametrize("file", sorted(PROOF.glob("*.py")), ids=lambda file: file.stem)
def test_the_proof_imports_only_values_and_tables(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            assert not name.startswith("camgen") or name.startswith(ALLOWED), name
