"""The reader accepts and refuses each form of the productions of a language as controllers do."""

from dataclasses import replace

import pytest

from bench.read.productions import Form, find_refusals, read_forms

LANGUAGES = ("gcode", "rapid", "vplus", "pacscript")
PRODUCTIONS: dict[str, list[Form]] = {}
for language in LANGUAGES:
    for form in read_forms(language):
        PRODUCTIONS.setdefault(f"{language}: {form.production}", []).append(form)


@pytest.mark.parametrize("production", PRODUCTIONS)
def test_the_reader_refuses_a_form_exactly_in_the_dialects_that_do(production: str) -> None:
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


def test_a_line_that_is_jumped_over_is_refused_like_one_that_runs() -> None:
    """Forms of V+ after a jump over them."""
    count = 0
    for form in read_forms("vplus"):
        is_statement = form.whole.startswith(f".PROGRAM a()\n{form.text}\n7\n")
        if is_statement and not form.text.startswith("GLOBAL"):
            skipped = replace(form, whole=form.whole.replace("a()\n", "a()\nGOTO 7\n", 1))
            assert bool(find_refusals("vplus", skipped)) is not form.taken, form.text
            count += 1
    assert count > 250
