"""No file has a line, an expression, a signature or a sentence that is hard to read.

`python -m tests.support.texture FILE` shows the places. A place that has to stay, such as a word in
the text of an input, has a row with its reason in `tests/texture/exempt.tsv`.
"""

from pathlib import Path

import pytest

from tests.support.texture import ROOT, Exemption, list_files, list_places, read_exemptions

EXEMPTIONS = read_exemptions()
FOLDERS = sorted({file.parent for file in list_files()})


def list_exemptions(file: Path) -> dict[Exemption, int]:
    """The exemption that each place of a file would need, and the last line that needs it."""
    name = file.relative_to(ROOT).as_posix()
    return {Exemption(name, place.kind, place.text): place.line for place in list_places(file)}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.relative_to(ROOT).as_posix())
def test_nothing_is_hard_to_read(folder: Path) -> None:
    needed: dict[Exemption, int] = {}
    for file in list_files():
        if file.parent == folder:
            needed.update(list_exemptions(file))
    hard = [(place, line) for place, line in needed.items() if place not in EXEMPTIONS]
    assert not hard, "python -m tests.support.texture FILE shows the places"


def test_each_exemption_has_its_place_and_its_reason() -> None:
    for exemption, reason in EXEMPTIONS.items():
        assert exemption in list_exemptions(ROOT / exemption.file)
        assert len(reason.split()) >= 3, exemption


SAMPLE = '''"""What is told of it."""
pairs = [a for a in [b for b in c]]
sign = 1 if x > 0 else -1 if x < 0 else 0
def place(a, b, c, d, e, f, *, g): ...
found = 1
# Nobody looked at it: a comment of one line.
'''


def test_each_kind_is_found(tmp_path: Path) -> None:
    file = tmp_path / "sample.py"
    file.write_text(SAMPLE + "x" * 101 + "\n")
    kinds = [(place.kind, place.line) for place in list_places(file)]
    prose = [("prose", line) for line in (1, 1, 1, 5, 6, 6)]
    others = [("nested", 2), ("conditional", 3), ("parameters", 4), ("wide", 7)]
    assert sorted(kinds) == sorted([*prose, *others])


SIGNATURES = """
def seven(a, /, b, c, *rest, d, e, **more): ...
class Value:
    def six(self, a, b, c, d, e, f): ...
    def longer(self, a, b, c, d, e, f, g): ...
"""


def test_each_kind_of_parameter_counts(tmp_path: Path) -> None:
    file = tmp_path / "signatures.py"
    file.write_text(SIGNATURES)
    places = [(place.kind, place.text) for place in list_places(file)]
    long = [("parameters", "seven: 7 parameters"), ("parameters", "longer: 7 parameters")]
    assert places == long
