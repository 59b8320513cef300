"""Plain entities are read from the text of a drawing by column, exactly as ezdxf reads them."""

import random
import re
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ezdxf.document import Drawing
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import InputTable, Job, OperationTable
from camgen.model.limits import Limits
from camgen.model.part import Part
from camgen.read import dxf
from camgen.read.dxf import document as loading
from camgen.read.dxf import plain
from camgen.read.files import Files
from tests.read.test_dxf import new, written
from tests.support.examples import fewer

FIXTURES = Path(__file__).parents[2] / "fixtures"
SHARED = Path(__file__).parents[2].parent / "shared" / "data"
FILES = sorted(
    path for path in chain(FIXTURES.rglob("*"), SHARED.rglob("*")) if path.suffix.lower() == ".dxf"
)
_HANDLE = re.compile(rb"\n *0\r?\n[A-Z0-9]+\r?\n *5\r?\n")
FLAT, IN_SPACE = Job(), Job(operation=OperationTable(kind="trace"))


def read_both(data: bytes, job: Job = FLAT, least: int = 1) -> Part | str:
    """The part, or the message of a refusal.

    ezdxf alone must give the same as reading that takes runs of `least` plain entities by column.
    """
    by_ezdxf, by_column = _read(data, job, None), _read(data, job, least)
    assert_same(by_ezdxf, by_column, handles=_HANDLE.search(data) is not None)
    return by_column


def _without_handle(text: Any, handles: bool) -> str:
    return str(text) if handles else re.sub(r" #\w+", "", str(text))


#: Loads a document. One document serves reading and inspecting, flat and in space: it takes long.
_LOAD = loading.load_document


@lru_cache(maxsize=2)
def _load(data: bytes, least: int | None) -> Any:
    """The document without runs of `least` plain entities, or whole if `least` is None."""
    split = (lambda _: None) if least is None else partial(plain.split, least=least)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loading, "split", split)
        return _LOAD("test.dxf", data)


def _read(data: bytes, job: Job, least: int | None) -> Part | str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dxf, "load_document", lambda _, data: _load(data, least))
        source = Source(Path("test.dxf"), data)
        try:
            part = dxf.read(source, job, Files())
        except InputError as error:
            return str(error)
        assert str(dxf.inspect(source, job, Files()))
        return part


def assert_same(first: Part | str, second: Part | str, handles: bool) -> None:
    """Parts, or messages, must be the same.

    handles: whether the file gives handles to entities. If not, ezdxf invents them for the entities
    that it reads, so they are not compared.
    """
    if isinstance(first, str) or isinstance(second, str):
        assert _without_handle(first, handles) == _without_handle(second, handles)
        return
    first_notes = [_without_handle(note, handles) for note in first.notes]
    assert first_notes == [_without_handle(note, handles) for note in second.notes]
    assert first.units == second.units
    for firsts, seconds in ((first.contours, second.contours), (first.curves, second.curves)):
        assert len(firsts) == len(seconds)
        for a, b in zip(firsts, seconds, strict=True):
            for field in a.__struct_fields__:
                assert np.array_equal(getattr(a, field), getattr(b, field)), field


@pytest.mark.parametrize("job", [FLAT, IN_SPACE], ids=["flat", "in space"])
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_drawing_is_read_as_by_ezdxf_alone(file: Path, job: Job) -> None:
    read_both(file.read_bytes(), job)


def drawing(seed: int, version: str) -> Drawing:
    """Runs of plain entities among others. Some of the entities are nearly plain."""
    draw = random.Random(seed)
    document, space = new(version=version)
    document.blocks.new("HOLE").add_circle((0, 0), 2)
    document.layers.add("off").off()

    def point() -> tuple[float, float, float]:
        return (
            draw.uniform(-500, 500),
            draw.choice([0.0, 1e-3, draw.uniform(-50, 50)]),
            draw.choice([0.0, 0.0, 1.0]),
        )

    unusual = {
        "invisible": [0, 1],
        "extrusion": [(0, 0, 1), (0, 0, -1)],
        "thickness": [0.0, 2.0],
        "paperspace": [1],
        "color": [0, 1, 7, 256],
        "linetype": ["CONTINUOUS"],
    }
    add: list[Callable[[dict[str, Any]], Any]] = [
        lambda attributes: space.add_line(point(), point(), attributes),
        lambda attributes: space.add_circle(point(), draw.choice([0.0, 1.0, 7.25]), attributes),
        lambda attributes: space.add_arc(
            point(), 3.0, draw.choice([0, 90, 400]), draw.choice([0, 180.5]), dxfattribs=attributes
        ),
        lambda attributes: space.add_polyline2d([(0, 0), (5, 5), (9, 0)], dxfattribs=attributes),
        lambda attributes: space.add_blockref("HOLE", point(), {"layer": attributes["layer"]}),
    ]
    for _ in range(draw.randint(1, 12)):
        attributes = {"layer": draw.choice(["0", "cut", "off", "Mull", "Müll", "a b"])}
        attributes |= {
            name: draw.choice(values) for name, values in unusual.items() if draw.random() < 0.1
        }
        kind = draw.choice([0, 0, 0, 1, 1, 2, 2, 3, 4])
        for _ in range(draw.randint(1, 5)):
            add[kind](attributes)
    return document


@fewer(15)
@given(
    seed=st.integers(0, 2**32),
    version=st.sampled_from(["R12", "R2000", "R2018"]),
    least=st.integers(1, 4),
)
def test_a_drawing_of_mixed_entities_is_read_as_by_ezdxf_alone(
    seed: int, version: str, least: int
) -> None:
    read_both(written(drawing(seed, version)).encode(), least=least)


#: Lines that a damaged drawing may have instead of another one.
DAMAGED_LINES = b"|x| 1|nan|1e999|-3|1_0|\\U+00e4|LINE| 40|999".split(b"|")


@fewer(15)
@given(seed=st.integers(0, 2**32), damage=st.integers(0, 2**32))
def test_a_damaged_drawing_is_read_as_by_ezdxf_alone(seed: int, damage: int) -> None:
    lines = written(drawing(seed, "R2000")).encode().split(b"\n")
    draw = random.Random(damage)
    first = lines.index(b"ENTITIES") + 1
    last = lines.index(b"ENDSEC", first)
    for _ in range(draw.randint(1, 3)):
        k = draw.randrange(first, last)
        lines[k] = draw.choice([*DAMAGED_LINES, lines[k + 1]])
    read_both(b"\n".join(lines))


def test_runs_of_plain_entities_leave_the_text_and_keep_their_place() -> None:
    document, space = new()
    for k in range(40):
        if k == 20:
            space.add_lwpolyline([(0, 900), (5, 900), (5, 905)], close=True)
        space.add_circle((10 * k, 0), 1 + k / 100, {"layer": "holes"})
    split = plain.split(written(document).encode())
    assert split is not None
    assert split.runs == {"CAMGEN-RUN-0": slice(0, 20), "CAMGEN-RUN-1": slice(20, 40)}
    assert b"CIRCLE" not in split.text[split.text.index(b"ENTITIES") :]
    assert split.plain.numbers[:, 3].tolist() == pytest.approx([1 + k / 100 for k in range(40)])
    part = read_both(written(document).encode(), least=plain.LEAST)
    assert isinstance(part, Part)
    assert [contour.id for contour in part.contours if contour.layer == "0"] == ["c21"]


def test_a_run_in_paper_space_is_not_read_as_model_space() -> None:
    document, space = new()
    space.add_circle((0, 0), 3)
    for k in range(30):
        document.paperspace().add_line((k, 0), (k, 5))
    part = read_both(written(document).encode())
    assert isinstance(part, Part)
    assert len(part.contours) == 1
    assert any("30 LINE" in str(note) and "paper" in str(note) for note in part.notes)


def test_a_layer_may_have_the_name_that_stands_for_a_run() -> None:
    document, space = new()
    for k in range(30):
        space.add_circle((10 * k, 0), 3, {"layer": "CAMGEN-RUN-0"})
    part = read_both(written(document).encode())
    assert isinstance(part, Part)
    assert {contour.layer for contour in part.contours} == {"CAMGEN-RUN-0"}


def test_plain_entities_count_against_the_limit() -> None:
    document, space = new()
    for k in range(60):
        space.add_circle((10 * k, 0), 3)
    source = Source(Path("test.dxf"), written(document).encode(), Limits(dxf_entities=50))
    with pytest.raises(InputError, match="more than 50 entities"):
        dxf.read(source, FLAT, Files())


def test_a_line_that_leaves_the_plane_is_named_with_its_handle() -> None:
    document, space = new()
    lines = [space.add_line((10 * k, 0, 0), (10 * k + 5, 0, 1 if k == 7 else 0)) for k in range(20)]
    part = read_both(
        written(document).encode(), Job(input=InputTable(), operation=OperationTable(kind="follow"))
    )
    assert isinstance(part, Part)
    assert any(
        f"LINE #{lines[7].dxf.handle} on layer 0 leaves the plane" in str(note)
        for note in part.notes
    )


def test_a_second_section_of_entities_is_read_as_by_ezdxf_alone() -> None:
    document, space = new()
    for k in range(30):
        space.add_circle((10 * k, 0), 3)
    text = written(document)
    begin = text.index("  0\nSECTION\n  2\nENTITIES")
    end = text.index("ENDSEC\n", begin) + len("ENDSEC\n")
    line = "  0\nLINE\n  8\n0\n 10\n0\n 20\n0\n 11\n9\n 21\n9\n"
    section = f"  0\nSECTION\n  2\nENTITIES\n{line}  0\nENDSEC\n"
    read_both((text[:end] + section + text[end:]).encode())
