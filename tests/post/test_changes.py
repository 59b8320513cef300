"""Tables of changed programs: each change has its finding or deviation."""

import pytest

from camgen.model.errors import VerifyError
from tests.post.changes import gcode, grbl, krl, pacscript, rapid, vplus
from tests.support.changes import Change, check_change
from tests.support.samples import Sample

TABLES = {
    "gcode": gcode,
    "grbl": grbl,
    "krl": krl,
    "pacscript": pacscript,
    "rapid": rapid,
    "vplus": vplus,
}
ROWS = []
for language, table in TABLES.items():
    for change in table.CHANGES:
        program = table.PROGRAMS[change.program]
        values = (change.program, change.kind, change.words[:40], change.after[:20])
        name = "-".join((language, *values))
        ROWS.append(pytest.param(program, change, id=name))


@pytest.mark.parametrize(("program", "change"), ROWS)
def test_a_changed_program_has_its_finding(program: Sample, change: Change) -> None:
    check_change(program, change)


@pytest.mark.parametrize("language", TABLES)
def test_a_row_that_is_wrong_in_one_value_fails(language: str) -> None:
    table = TABLES[language]
    row = table.CHANGES[0]
    other_kind = "remark" if row.kind == "fault" else "fault"
    wrong_rows = [
        row._replace(words=f"{row.words}."),
        row._replace(kind=other_kind),
        row._replace(times=row.times + 1),
        row._replace(others=not row.others),
        row._replace(line=99),
        row._replace(kind="deviation"),
        row._replace(before="not in the text"),
        row._replace(after=row.before),
    ]
    for wrong in wrong_rows:
        with pytest.raises(AssertionError):
            check_change(table.PROGRAMS[row.program], wrong)


def test_a_row_of_another_kind_fails() -> None:
    first_rows = {row.kind: row for row in reversed(pacscript.CHANGES)}
    assert len(first_rows) == 4
    for row in first_rows.values():
        for kind in first_rows.keys() - {row.kind}:
            wrong = row._replace(kind=kind, words=row.words or "a deviation")
            with pytest.raises((AssertionError, VerifyError, pytest.fail.Exception)):
                check_change(pacscript.PROGRAMS[row.program], wrong)


@pytest.mark.parametrize("language", TABLES)
def test_each_program_of_a_table_is_changed(language: str) -> None:
    table = TABLES[language]
    assert {change.program for change in table.CHANGES} == set(table.PROGRAMS)
