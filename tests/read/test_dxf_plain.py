"""Entities that are cut out of a DXF text are read as ezdxf reads them, in drawing order."""

from __future__ import annotations

import importlib
from io import StringIO
from pathlib import Path

import ezdxf
import pytest
from ezdxf.document import Drawing

from camgen.model.job import Job
from camgen.model.part import Contour
from camgen.read.dxf.plain import cut
from camgen.read.files import Files

dxf = importlib.import_module("camgen.read.dxf")


def draw() -> Drawing:
    """Plain entities between others, on layers, in colors, and one in paper space."""
    document = ezdxf.new("R2010", units=4)
    document.layers.add("off layer").off()
    space = document.modelspace()
    space.add_line((0, 0), (40, 0), dxfattribs={"color": 1})
    space.add_line((40, 0), (40, 30), dxfattribs={"lineweight": 25, "linetype": "CONTINUOUS"})
    space.add_lwpolyline([(40, 30), (0, 30), (0, 0)])
    space.add_circle((20, 15), 5, dxfattribs={"layer": "holes", "color": 256})
    block = document.blocks.new("slot")
    block.add_circle((0, 0), 1)
    space.add_blockref("slot", (60, 60))
    space.add_arc((80, 15), 6, 30, 330, dxfattribs={"layer": "off layer"})
    space.add_arc((80, 15), 6, 30, 330, dxfattribs={"layer": "holes"})
    space.add_line((85, 12), (85, 18), dxfattribs={"layer": "holes", "thickness": 2})
    space.add_circle((20, 80), -1)
    space.add_circle((0, 90, 2), 3, dxfattribs={"extrusion": (0, 0, -1)})
    document.paperspace().add_circle((0, 0), 7)
    return document


def text_of(document: Drawing) -> str:
    stream = StringIO()
    document.write(stream)
    return stream.getvalue()


def shown(contours: tuple[Contour, ...]) -> list[object]:
    return [(c.id, c.layer, c.color, c.closed, c.points.tolist(), c.bulges.tolist()) for c in contours]


def read_both(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What is read of ``text`` with plain entities cut out, and by ezdxf alone."""
    path = folder / "drawing.dxf"
    path.write_bytes(text.encode())
    found: list[object] = []
    for way in (cut, lambda _: None):
        monkeypatch.setattr(dxf, "cut", way)
        part = dxf.read(Files().read(path), Job(), Files())
        found.append((shown(part.contours), part.notes))
        found.append(str(dxf.inspect(Files().read(path), Job(), Files())))
    return found


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_they_read_as_by_ezdxf(end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = text_of(draw()).replace("\n", end)
    plain = cut(text.encode())
    assert plain is not None
    # Odd are the arc after the reference, the line with a thickness, and the circles seen from below and on paper.
    assert plain.kinds == ["LINE", "LINE", "CIRCLE", "ARC", "CIRCLE"]
    first, page, again, page_again = read_both(text, tmp_path, monkeypatch)
    assert first == again
    assert page == page_again


def test_the_rest_is_a_whole_drawing() -> None:
    plain = cut(text_of(draw()).encode())
    assert plain is not None
    rest = ezdxf.read(StringIO(plain.rest.decode()))
    assert [entity.dxftype() for entity in rest.modelspace()] == ["LWPOLYLINE", "INSERT", "ARC", "LINE", "CIRCLE"]


def test_those_in_paper_space_are_not_taken_for_the_part() -> None:
    flag = "\n 67\n1\n"
    text = text_of(draw())
    assert text.count(flag) == 1
    plain = cut(text.replace(flag, "\n").encode())
    assert plain is not None
    assert not plain.belong(ezdxf.read(StringIO(plain.rest.decode())))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("AC1024", "AC1009"),  # no classes
        ("\nENTITIES\n", "\nOTHERS\n"),
        ("\nAcDbLine\n", "\nAcDbLine\n999\n"),  # a line too many
    ],
)
def test_an_odd_file_is_read_as_a_whole(old: str, new: str) -> None:
    text = text_of(draw())
    assert old in text
    assert cut(text.replace(old, new, 1).encode()) is None


def test_a_handle_that_is_used_twice_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = draw()
    lines = document.modelspace().query("LINE")
    text = text_of(document).replace(f"\n  5\n{lines[1].dxf.handle}\n", f"\n  5\n{lines[0].dxf.handle}\n")
    assert cut(text.encode()) is None
    first, page, again, page_again = read_both(text, tmp_path, monkeypatch)
    assert (first, page) == (again, page_again)
