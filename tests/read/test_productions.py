"""The productions of the languages that are read, form by form: what controllers take, and what they turn down."""

import pytest

from bench.read.productions import Form, judge_form, read_forms, refusing

LANGUAGES = ("gcode", "rapid")
PRODUCTIONS: dict[str, list[Form]] = {}
for language in LANGUAGES:
    for form in read_forms(language):
        PRODUCTIONS.setdefault(f"{language}: {form.production}", []).append(form)


@pytest.mark.parametrize("production", PRODUCTIONS)
def test_the_reader_takes_and_turns_down_what_controllers_do(production: str) -> None:
    language = production.partition(":")[0]
    for form in PRODUCTIONS[production]:
        expected = () if form.taken else form.dialects
        assert refusing(language, form) == expected, (form.text, judge_form(language, form))


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_language_has_forms_of_both_kinds(language: str) -> None:
    forms = read_forms(language)
    assert len({(form.production, form.whole) for form in forms}) == len(forms)
    assert sum(not form.taken for form in forms) > len(forms) // 5
