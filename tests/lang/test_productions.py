"""The productions of the languages that are read, form by form: what controllers take, and what they turn down."""

from dataclasses import replace

import pytest

from bench.read.productions import Form, find_refusals, read_forms

LANGUAGES = ("gcode", "rapid", "vplus", "pacscript")
PRODUCTIONS: dict[str, list[Form]] = {}
for language in LANGUAGES:
    for form in read_forms(language):
        PRODUCTIONS.setdefault(f"{language}: {form.production}", []).append(form)


@pytest.mark.parametrize("production", PRODUCTIONS)
def test_the_reader_takes_and_turns_down_what_controllers_do(production: str) -> None:
    language = production.partition(":")[0]
    for form in PRODUCTIONS[production]:
        expected = () if form.taken else form.dialects
        refusals = find_refusals(language, form)
        assert tuple(refusals) == expected, (form.text, refusals)


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_language_has_forms_of_both_kinds(language: str) -> None:
    forms = read_forms(language)
    assert len({(form.production, form.whole) for form in forms}) == len(forms)
    assert sum(not form.taken for form in forms) > len(forms) // 5


def test_lines_that_do_not_run_are_judged_as_those_that_do() -> None:
    """V+, behind a jump over them."""
    count = 0
    for form in read_forms("vplus"):
        if form.whole.startswith(f".PROGRAM a()\n{form.text}\n7\n") and not form.text.startswith(
            "GLOBAL"
        ):
            skipped = replace(
                form, whole=form.whole.replace(".PROGRAM a()\n", ".PROGRAM a()\nGOTO 7\n", 1)
            )
            assert bool(find_refusals("vplus", skipped)) is not form.taken, form.text
            count += 1
    assert count > 250
