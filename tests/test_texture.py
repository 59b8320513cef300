"""The counts of the texture of the code may only fall; `tests/texture/counts.tsv` holds them.

`python -m tests.support.texture FILE` shows the places. A file that is moved, renamed or split
takes its row along, except into a future `lang` room; a new file has no row, so it starts at zero.
"""

from pathlib import Path

import pytest

from tests.support.texture import KINDS, ROOT, count, list_files, list_places, read_table

TABLE = read_table()
NOTHING = (0,) * len(KINDS)
FOLDERS = sorted({file.parent for file in list_files()})


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.relative_to(ROOT).as_posix())
def test_no_count_rises(folder: Path) -> None:
    risen, fallen = [], []
    for file in list_files():
        if file.parent != folder:
            continue
        name = file.relative_to(ROOT).as_posix()
        counts, allowed = count(file), TABLE.get(name, NOTHING)
        for kind, now, before in zip(KINDS, counts, allowed, strict=True):
            if now > before:
                risen.append(f"{name}: {kind}: {now}, not more than {before}")
            elif now < before:
                fallen.append(f"{name}: {kind}: {now}, the table allows {before}")
    assert not risen, "python -m tests.support.texture FILE shows the places"
    assert not fallen, "python -m tests.support.texture --lower writes the lower counts"


def test_each_row_has_its_file() -> None:
    assert [name for name in TABLE if not (ROOT / name).is_file()] == []


SAMPLE = '''"""What is told of it."""
pairs = [a for a in [b for b in c]]
sign = 1 if x > 0 else -1 if x < 0 else 0
def place(a, b, c, d, e, f, *, g): ...
found = 1
# Nobody looked at it: a comment of one line.
'''


def test_each_kind_is_counted(tmp_path: Path) -> None:
    file = tmp_path / "sample.py"
    file.write_text(SAMPLE + "x" * 101 + "\n")
    kinds = [(place.kind, place.line) for place in list_places(file)]
    prose = [("prose", line) for line in (1, 1, 1, 5, 6, 6)]
    others = [("nested", 2), ("conditional", 3), ("parameters", 4), ("wide", 7)]
    assert sorted(kinds) == sorted([*prose, *others])
