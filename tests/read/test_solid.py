"""3-D parts are inspected, and get a job file."""

from pathlib import Path

import pytest

from camgen.cli import main
from camgen.model.errors import JobError
from camgen.model.job import InputTable, Job
from camgen.read import find_reader, inspect
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


def test_inspect_lists_the_edges_of_a_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(PARTS / "rfa1.stl")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "3-D part of 125 x 95 x 70 mm, units mm, 396 triangles"
    assert lines[1] == "bodies: 1"
    assert lines[2] == "edges: 21, 21 convex (17 lines, 2 circles, 2 arcs), 0 concave"
    assert "e1: line, 125 mm, 39.8 deg, convex, from 0 30 70" in lines
    assert sum(line.startswith("e") and " deg, convex" in line for line in lines) == 21


def test_the_units_of_a_mesh_come_from_the_job() -> None:
    inches = str(inspect(PARTS / "rfa1.stl", Job(input=InputTable(units="inch"))))
    assert "3-D part of 3175 x 2413 x 1778 mm" in inches
    with pytest.raises(JobError, match="unknown unit"):
        inspect(PARTS / "rfa1.stl", Job(input=InputTable(units="elbow")))
    with pytest.raises(JobError, match="states its own"):
        inspect(PARTS / "rfa1.step", Job(input=InputTable(units="inch")))


def test_init_writes_a_job_file_for_a_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.stl").write_bytes((PARTS / "rfa1.stl").read_bytes())
    assert main(["init", str(tmp_path / "part.stl"), "-q"]) == 0
    assert (tmp_path / "part.toml").exists()


@pytest.mark.parametrize(
    ("name", "kind"), [("a.STL", "solid"), ("a.stp", "solid"), ("a.glb", "solid"), ("a", "dxf")]
)
def test_a_file_of_unknown_content_is_recognised_by_its_suffix(
    tmp_path: Path, name: str, kind: str
) -> None:
    (tmp_path / name).write_bytes(b"\0")
    assert find_reader(source(tmp_path / name)).name == kind
