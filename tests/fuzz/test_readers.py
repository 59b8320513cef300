"""Nearly valid inputs give a value or an error in one line, in every reader and read-back.

The table is that of `python -m bench.reliability.fuzz`, which tries many more inputs. The inputs in
which it found faults are tested at the end of this file.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from bench.reliability.fuzzing import table
from bench.reliability.fuzzing.table import TABLE, Fuzzed, Miss, read_twice
from camgen.lang.programs import Executed
from camgen.localize import scans
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.program import Output
from camgen.read.solid import mesh_file

EXAMPLES = 15


@pytest.mark.parametrize("fuzzed", TABLE, ids=lambda fuzzed: fuzzed.name)
def test_a_nearly_valid_input_gives_a_value_or_an_error(fuzzed: Fuzzed) -> None:
    # The examples are always the same, so that a failure is repeated. The bench tries new ones.
    @settings(
        max_examples=max(3, round(EXAMPLES * fuzzed.weight)),
        derandomize=True,
        database=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=list(HealthCheck),
    )
    @given(fuzzed.inputs)
    def attempt(data: bytes) -> None:
        read_twice(fuzzed, data)

    attempt()


# The test of inputs itself finds each kind of miss.


def make_fuzzed(call: object, never_fails: bool = False) -> Fuzzed:
    return Fuzzed("odd", TABLE[0].inputs, call, never_fails)  # type: ignore[arg-type]


def make_raising(error: Exception) -> object:
    def call(_data: bytes) -> object:
        raise error

    return call


def test_each_kind_of_miss_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read_twice(make_fuzzed(lambda data: data), b"x")
    assert not read_twice(make_fuzzed(make_raising(InputError("a", "is odd"))), b"x")
    with pytest.raises(Miss, match="InputError: a: is odd"):
        read_twice(make_fuzzed(make_raising(InputError("a", "is odd")), never_fails=True), b"x")
    with pytest.raises(KeyError):
        read_twice(make_fuzzed(make_raising(KeyError("x"))), b"x")
    body = (Output("a", float("nan")),)
    with pytest.raises(Miss, match="not finite: nan"):
        read_twice(make_fuzzed(lambda _data: Executed(body, (1,))), b"x")
    numbers = iter(range(9))
    with pytest.raises(Miss, match="read twice"):
        read_twice(make_fuzzed(lambda _data: next(numbers)), b"x")
    monkeypatch.setattr(table, "SECONDS", 0.05)
    with pytest.raises(Miss, match="no end within"):
        read_twice(make_fuzzed(lambda _data: sum(k for k in range(10**9))), b"x")


# Inputs in which the bench found faults.


def make_cloud(**fields: str) -> bytes:
    head = {
        "FIELDS": "x y z",
        "SIZE": "4 4 4",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "POINTS": "100",
        "DATA": "binary",
    }
    return "".join(f"{key} {value}\n" for key, value in (head | fields).items()).encode() + bytes(
        1200
    )


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        # A reader that believed this number used up the memory.
        ({"COUNT": "1000000000 1 1"}, "its COUNT is beyond the 10,000 numbers"),
        ({"COUNT": "-1 1 1"}, "its COUNT is beyond"),
        ({"SIZE": "-4 4 4"}, "'F-4'"),
        ({"SIZE": "3 3 3"}, "'F3'"),
    ],
)
def test_a_point_cloud_with_impossible_numbers_is_refused(
    fields: dict[str, str], what: str
) -> None:
    with pytest.raises(InputError, match=f"is damaged or no PCD point cloud: .*{what}"):
        scans.read_scan(Source(Path("scan.pcd"), make_cloud(**fields)))


def test_a_point_cloud_without_a_format_is_refused() -> None:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    with pytest.raises(
        InputError, match="is damaged or no PLY point cloud: its head has no format"
    ):
        scans.read_scan(
            Source(Path("scan.ply"), f"ply\nelement vertex 1\n{axes}end_header\n1 2 3\n".encode())
        )


def test_a_3mf_without_its_model_is_refused() -> None:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        zipped.writestr("3D/other.model", "<model/>")
    with pytest.raises(
        InputError,
        match=r"a\.3mf: lacks the model of a 3MF: 3D/3dmodel\.model is not in it; export it again",
    ):
        mesh_file.read_mesh(Source(Path("a.3mf"), archive.getvalue()))
