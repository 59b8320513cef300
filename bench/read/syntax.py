"""The readers of programs against other judges of their languages' syntax.

python -m bench.read.syntax LANGUAGE [JUDGE[=PATH] ...]: every form of tests/lang/LANGUAGE/productions.txt through
camgen's reader and through each judge, which is installed beside camgen, or lies at PATH, and is no part of it. A table
of how many agree with the manual, and each difference with its reason; exit 1 where a reader differs, or a judge
without a reason that is written down.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from time import perf_counter

from bench.read.judges import JUDGES, POSTS, Judge, write_samples
from bench.read.productions import Form, judge_form, read_forms, refusing
from bench.support.runner import Table, machine
from camgen.model.text import counted


def show(form: Form) -> str:
    """A form in one line."""
    return f"{'+' if form.taken else '-'} `{form.text.replace(chr(10), ' ¶ ')}` ({form.production})"


def against_reader(language: str, forms: Iterable[Form]) -> list[str]:
    """The forms at which the reader differs from what they are written down as."""
    wrong = []
    for form in forms:
        refused = refusing(language, form)
        if refused and form.taken:
            wrong.append(f"{show(form)}: refused: {judge_form(language, form)[0]}")
        elif not form.taken and len(refused) < len(form.dialects):
            taken = ", ".join(one for one in form.dialects if one not in refused)
            wrong.append(f"{show(form)}: taken{taken and f' ({taken})'}")
    return wrong


def against(
    name: str, judge: Judge, forms: Iterable[Form]
) -> tuple[int, dict[str, list[str]], list[str]]:
    """Forms that the judge can judge, differences by the reason that is written down, and those without one."""
    known: dict[str, list[str]] = {}
    open_ones, count = [], 0
    for form in forms:
        takes = judge(form)
        if takes is None:
            continue
        count += 1
        if takes == form.taken:
            continue
        if name in form.differs:
            known.setdefault(form.differs[name], []).append(show(form))
        else:
            open_ones.append(f"{show(form)}: {'taken' if takes else 'refused'} by {name}")
    return count, known, open_ones


def find_judge(language: str, word: str) -> tuple[str, Judge]:
    """A judge by its word of the command line, NAME or NAME=PATH. SystemExit where there is none of the name."""
    name, _, path = word.partition("=")
    make: Callable[[str], Judge] | None = JUDGES[language].get(name)
    if make is None:
        raise SystemExit(
            f"{name}: no judge of {language}; there are {', '.join([*JUDGES[language], 'posts'])}"
        )
    return name, make(path)


def against_posts(language: str, path: str) -> tuple[int, dict[str, list[str]], list[str]]:
    """As ``against``, of the programs that the posts in the folder ``path`` write: controllers take them, but those
    with a reason.
    """
    known: dict[str, list[str]] = {}
    open_ones = []
    samples = write_samples(language, path)
    for name, text in samples.items():
        said, why = judge_form(language, Form("posts", 0, name, text, True)), POSTS[language][name]
        if said and why:
            known.setdefault(why, []).append(name)
        elif said or why:
            open_ones.append(f"{name}: {said[0] if said else 'taken'}")
    return len(samples), known, open_ones


def judge_all(
    language: str, word: str, forms: Sequence[Form]
) -> tuple[str, tuple[int, dict[str, list[str]], list[str]]]:
    """The name of a judge of the command line and what it says of all forms. posts: what others write, read by us."""
    if word.startswith("posts="):
        return "posts", against_posts(language, word.removeprefix("posts="))
    name, judge = find_judge(language, word)
    return name, against(name, judge, forms)


def main(words: list[str]) -> int:
    """Prints the table and the differences."""
    if not words or words[0] not in JUDGES:
        raise SystemExit(f"python -m bench.read.syntax {'|'.join(JUDGES)} [JUDGE[=PATH] ...]")
    language, *named = words
    forms = read_forms(language)
    begin = perf_counter()
    wrong = against_reader(language, forms)
    productions = len({form.production for form in forms})
    print(f"{machine()}\n\n{language}: {len(forms)} forms of {productions} productions")
    table = Table("judge | forms | as the manual | differ, with a reason | differ")
    seconds = perf_counter() - begin
    table.add(f"camgen, {seconds:.1f} s", len(forms), len(forms) - len(wrong), 0, len(wrong))
    rows = {}
    for word in named:
        name, result = judge_all(language, word, forms)
        count, known, rest = rows[name] = result
        told = sum(map(len, known.values()))
        table.add(name, count, count - told - len(rest), told, len(rest))
    for name, (_, known, rest) in {"camgen": (0, {}, wrong), **rows}.items():
        if known or rest:
            told = [
                f"{counted(len(some), 'form')}: {why}: {', '.join(some[:4])}"
                for why, some in known.items()
            ]
            print(f"\n{name}:\n" + "\n".join(f"- {one}" for one in [*rest, *told]))
    return 1 if wrong or any(rest for _, _, rest in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
