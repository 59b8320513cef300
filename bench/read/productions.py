"""The productions of a language, form by form, and what camgen's reader says to each.

tests/lang/<language>/productions.txt holds them: a line ``+`` and a form that controllers take, ``-`` and one that they
refuse; ``==`` and the name of a production, behind ``|`` the dialects; ``@`` and the lines that its forms stand in, for
``$``, before the first production those of all that have none of their own; ``!`` and a judge, and why it differs from
the manual: behind a form there, before the first form of a production in all of it. ``¶`` ends a line.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from camgen.lang.programs import Ask, find_language

FOLDER = Path(__file__).parents[2] / "tests" / "lang"
_NAMES = {"gcode": "a.nc", "rapid": "a.mod", "vplus": "a.v2", "pacscript": "a.pcs"}


@dataclass(frozen=True)
class Form:
    """One form. production, number: its place. text: as it is written; whole: with the lines that it stands in.
    taken: whether controllers take it, by the manual. differs: judges that say otherwise, and why.
    """

    production: str
    number: int
    text: str
    whole: str
    taken: bool
    dialects: tuple[str, ...] = ("",)
    differs: dict[str, str] = field(default_factory=dict)


def read_forms(language: str) -> list[Form]:
    """All forms of a language's productions, in their order. ValueError for a line that is none of the format."""
    forms: list[Form] = []
    usual = around = "$"
    name, dialects, common = "", ("",), dict[str, str]()
    for line in (FOLDER / language / "productions.txt").read_text(encoding="utf-8").splitlines():
        sign, rest = line[:2].strip(), line[2:].strip(" ")
        if sign == "==":
            name, _, some = (part.strip() for part in rest.partition("|"))
            around, dialects, common = usual, tuple(some.split()) or ("",), {}
        elif sign == "@":
            around, usual = rest, usual if name else rest
        elif sign == "!":
            judge, _, why = rest.partition(": ")
            (forms[-1].differs if forms and forms[-1].production == name else common)[judge] = why
        elif sign in ("+", "-"):
            text, whole = (
                rest.replace("¶", "\n"),
                around.replace("$", rest).replace("¶", "\n") + "\n",
            )
            forms.append(Form(name, len(forms), text, whole, sign == "+", dialects, dict(common)))
        elif sign and not line.startswith("#"):
            raise ValueError(f"{language}: {line!r} begins with none of == @ ! + - #")
    return forms


def judge_form(language: str, form: Form) -> list[str]:
    """What camgen's reader turns down in a form, in any of its dialects; nothing where it takes it."""
    run = find_language(language).run
    said = []
    for dialect in form.dialects:
        found = run({_NAMES[language]: form.whole}, Ask(dialect))
        said += [
            f"{one.what} {dialect}".rstrip() for one in found.findings if one.level == "refused"
        ]
        said += [] if found.stopped is None else [f"{found.stopped[1]} {dialect}".rstrip()]
    return said


def refusing(language: str, form: Form) -> tuple[str, ...]:
    """The dialects of a form whose reading turns it down."""
    run = find_language(language).run
    found = {one: run({_NAMES[language]: form.whole}, Ask(one)) for one in form.dialects}
    return tuple(
        one
        for one, said in found.items()
        if said.stopped or any(item.level == "refused" for item in said.findings)
    )
