"""What fixtures/make.py makes is what is committed."""

import subprocess
import sys
from pathlib import Path

FIXTURES = Path(__file__).parents[1] / "fixtures"


def test_the_made_fixtures_are_the_committed_ones(tmp_path: Path) -> None:
    subprocess.run([sys.executable, str(FIXTURES / "make.py"), str(tmp_path)], check=True, timeout=60)
    made = sorted(p for p in tmp_path.rglob("*") if p.is_file())
    assert made
    for file in made:
        assert file.read_bytes() == (FIXTURES / file.relative_to(tmp_path)).read_bytes(), file.name
