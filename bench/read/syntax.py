"""The readers of programs against other judges of their languages' syntax.

    python -m bench.read.syntax LANGUAGE [JUDGE[=PATH] ...]

Every form of tests/lang/LANGUAGE/productions.txt runs through camgen's reader and through each
judge. A judge is a program of others, installed beside camgen or found at PATH. The judge
``posts=PATH`` is a folder of other posts, whose programs camgen's reader reads. The table counts
the forms on which a judge agrees with the manual; each difference is listed with its reason. The
exit code is 1 if the reader differs, or a judge without a known reason.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from bench.read.judges import JUDGES, POSTS, Judge, write_samples
from bench.read.productions import Form, find_refusals, read_forms
from bench.support.runner import Table, machine
from bench.support.timing import timed
from camgen.model.text import counted


class Comparison(NamedTuple):
    """A judge compared with the manual.

    count: number of forms that it judges.
    known: its differences, by the reason in the productions.
    unknown: its differences without a reason.
    """

    count: int
    known: dict[str, list[str]]
    unknown: list[str]


def format_form(form: Form) -> str:
    """A form in one line."""
    return f"{'+' if form.taken else '-'} `{form.text.replace(chr(10), ' ¶ ')}` ({form.production})"


def compare_reader(language: str, forms: Sequence[Form]) -> Comparison:
    """Compares camgen's reader with the manual."""
    differences = []
    for form in forms:
        refusals = find_refusals(language, form)
        if refusals and form.taken:
            reasons = next(iter(refusals.values()))
            differences.append(f"{format_form(form)}: refused: {reasons[0]}")
        elif not form.taken and len(refusals) < len(form.dialects):
            taken = ", ".join(dialect for dialect in form.dialects if dialect not in refusals)
            differences.append(f"{format_form(form)}: taken{taken and f' ({taken})'}")
    return Comparison(len(forms), {}, differences)


def compare_judge(name: str, peer: Judge, forms: Iterable[Form]) -> Comparison:
    """Compares a judge with the manual, in the forms that it can judge."""
    known: dict[str, list[str]] = {}
    unknown, count = [], 0
    for form in forms:
        takes = peer(form)
        if takes is None:
            continue
        count += 1
        if takes == form.taken:
            continue
        if name in form.differs:
            known.setdefault(form.differs[name], []).append(format_form(form))
        else:
            unknown.append(f"{format_form(form)}: {'taken' if takes else 'refused'} by {name}")
    return Comparison(count, known, unknown)


def compare_posts(language: str, path: str) -> Comparison:
    """Reads the programs of other posts. The reader takes all of them, except those with a reason.

    path: the folder with the posts.
    """
    known: dict[str, list[str]] = {}
    unknown = []
    samples = write_samples(language, path)
    for name, text in samples.items():
        refusals = find_refusals(language, Form("posts", 0, name, text, True))
        reason = POSTS[language][name]
        if refusals and reason:
            known.setdefault(reason, []).append(name)
        elif refusals:
            unknown.append(f"{name}: {refusals[''][0]}")
        elif reason:
            unknown.append(f"{name}: taken")
    return Comparison(len(samples), known, unknown)


def compare_named(language: str, word: str, forms: Sequence[Form]) -> tuple[str, Comparison]:
    """The name of a judge and its comparison. SystemExit if the language has no such judge.

    word: a word of the command line, NAME or NAME=PATH.
    """
    name, _, path = word.partition("=")
    if name == "posts" and path:
        return name, compare_posts(language, path)
    if name not in JUDGES[language]:
        names = ", ".join([*JUDGES[language], "posts"])
        raise SystemExit(f"{name}: no judge of {language}; there are {names}")
    return name, compare_judge(name, JUDGES[language][name](path), forms)


def main(words: list[str]) -> int:
    """Prints the table and the differences."""
    if not words or words[0] not in JUDGES:
        raise SystemExit(f"python -m bench.read.syntax {'|'.join(JUDGES)} [JUDGE[=PATH] ...]")
    language, *judges = words
    forms = read_forms(language)
    reader, seconds = timed(lambda: compare_reader(language, forms))
    productions = len({form.production for form in forms})
    print(f"{machine()}\n\n{language}: {len(forms)} forms of {productions} productions")
    table = Table("judge | forms | as the manual | differ, with a reason | differ")
    comparisons = {"camgen": reader}
    _add_row(table, f"camgen, {seconds:.1f} s", reader)
    for word in judges:
        name, comparison = compare_named(language, word, forms)
        comparisons[name] = comparison
        _add_row(table, name, comparison)
    for name, (_, known, unknown) in comparisons.items():
        lines = list(unknown)
        for reason, texts in known.items():
            lines.append(f"{counted(len(texts), 'form')}: {reason}: {', '.join(texts[:4])}")
        if lines:
            print(f"\n{name}:\n" + "\n".join(f"- {line}" for line in lines))
    return int(any(comparison.unknown for comparison in comparisons.values()))


def _add_row(table: Table, name: str, comparison: Comparison) -> None:
    known = sum(map(len, comparison.known.values()))
    unknown = len(comparison.unknown)
    table.add(name, comparison.count, comparison.count - known - unknown, known, unknown)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
