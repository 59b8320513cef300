"""The productions of a language, form by form, and the refusals of camgen's reader.

tests/lang/<language>/productions.txt holds them. A line starts with a sign:

    + FORM                  a form that controllers take
    - FORM                  a form that controllers refuse
    == NAME | DIALECT ...   a production, with the dialects of its forms
    @ LINES                 the lines around a form, which replaces ``$`` in them. Before the first
                            production: the lines of all productions that have none
    ! JUDGE: REASON         a judge that differs from the manual: for the form above, or for the
                            whole production if no form of it comes before

``¶`` ends a line.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from camgen.lang.programs import RunRequest, find_language

FOLDER = Path(__file__).parents[2] / "tests" / "lang"
_NAMES = {"gcode": "a.nc", "rapid": "a.mod", "vplus": "a.v2", "pacscript": "a.pcs"}


@dataclass(frozen=True)
class Form:
    """A form of a production.

    production: name of the production.
    number: index of the form among those of the language.
    text: the form as it is written.
    whole: the form with the lines around it.
    taken: whether controllers take it, by the manual.
    dialects: dialects in which the form is read.
    differs: reason for each judge that differs from the manual.
    """

    production: str
    number: int
    text: str
    whole: str
    taken: bool
    dialects: tuple[str, ...] = ("",)
    differs: dict[str, str] = field(default_factory=dict)


def read_forms(language: str) -> list[Form]:
    """All forms of a language's productions, in their order. ValueError for an unknown sign."""
    forms: list[Form] = []
    usual = around = "$"
    name, dialects, common = "", ("",), dict[str, str]()
    for line in (FOLDER / language / "productions.txt").read_text(encoding="utf-8").splitlines():
        sign, rest = line[:2].strip(), line[2:].strip(" ")
        if sign == "==":
            name, _, words = (part.strip() for part in rest.partition("|"))
            around, dialects, common = usual, tuple(words.split()) or ("",), {}
        elif sign == "@":
            around, usual = rest, usual if name else rest
        elif sign == "!":
            peer, _, reason = rest.partition(": ")
            is_of_form = forms and forms[-1].production == name
            (forms[-1].differs if is_of_form else common)[peer] = reason
        elif sign in ("+", "-"):
            text = rest.replace("¶", "\n")
            whole = around.replace("$", rest).replace("¶", "\n") + "\n"
            forms.append(Form(name, len(forms), text, whole, sign == "+", dialects, dict(common)))
        elif sign and not line.startswith("#"):
            raise ValueError(f"{language}: {line!r} begins with none of == @ ! + - #")
    return forms


def find_refusals(language: str, form: Form) -> dict[str, list[str]]:
    """The reasons for which camgen's reader refuses a form, for each dialect that refuses it."""
    run = find_language(language).run
    refusals = {}
    for dialect in form.dialects:
        executed = run({_NAMES[language]: form.whole}, RunRequest(dialect))
        reasons = [finding.what for finding in executed.findings if finding.level == "refused"]
        if executed.stopped is not None:
            reasons.append(executed.stopped[1])
        if reasons:
            refusals[dialect] = [f"{reason} {dialect}".rstrip() for reason in reasons]
    return refusals
