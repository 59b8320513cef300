"""Names in docstrings, comments and pages lead to code that exists."""

from pathlib import Path

import pytest

from tests.support.references import (
    ROOT,
    Reference,
    leads_somewhere,
    list_all,
    list_references,
)

#: Names that look like references and are not, with the reason.
NOT_REFERENCES = {
    "a_from_b": "the pattern of the names of transforms",
    "object.member": "a form of PacScript",
    "p.trans": "a form of RAPID",
    "ros.srv.cmd": "a file of a public V+ project",
    "table.key": "the pattern of the names of settings",
    "v2py.py": "a file of a public project",
    "shared/data": "a folder beside the repository",
    "DIR/left": "a folder of the user",
}


@pytest.fixture(scope="module")
def references() -> list[Reference]:
    return list_all()


@pytest.fixture(scope="module")
def lost_references(references: list[Reference]) -> list[Reference]:
    return [reference for reference in references if not leads_somewhere(reference)]


def test_each_reference_leads_somewhere(lost_references: list[Reference]) -> None:
    lost = [str(reference) for reference in lost_references if reference.name not in NOT_REFERENCES]
    assert lost == []


def test_each_exception_is_needed(lost_references: list[Reference]) -> None:
    assert {reference.name for reference in lost_references} == NOT_REFERENCES.keys()


def test_references_are_found_in_all_folders(references: list[Reference]) -> None:
    counts = dict.fromkeys(("camgen", "postprocessors", "docs", "bench", "tests"), 0)
    for reference in references:
        top = reference.file.relative_to(ROOT).parts[0]
        if top in counts:
            counts[top] += 1
    assert min(counts.values()) > 10, counts


#: Names beside those that exist: a module that has moved, a member, a class, a file, a setting.
MISSING = """`order/matrix` `matrix.Dices` `verify.COMPARE` `Part.contour` `check/corner.py`
`tool.diametr` `read_modul` camgen.tours.speed and saddle.py are not there."""
EXISTING = """`order/solver/matrix` `matrix.Dice` `verify.COMPARED` `Part.contours` `check/reach.py`
`tool.diameter` `read_module` `part.dxf` `WAIT.EVENT` `np.cross` camgen.order.solver.speed."""


@pytest.mark.parametrize(("text", "leads"), [(MISSING, False), (EXISTING, True)])
def test_existing_and_missing_names_are_distinguished(
    text: str, leads: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = ROOT / "camgen" / "geometry" / "vectors.py"
    monkeypatch.setattr("tests.support.references._list_texts", lambda _: [(1, text)])
    references = list(list_references(file))
    assert len(references) == 9
    assert [leads_somewhere(reference) for reference in references] == [leads] * 9


def test_names_of_other_languages_on_a_page_are_no_references(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("`g28.x` is a parameter, `path.cut` a style, `verify.COMPARE` a mistake.\n")
    assert list(list_references(page)) == [Reference(page, 1, "verify.COMPARE")]
