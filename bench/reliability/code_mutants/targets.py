"""The modules that are mutated, and the draw of mutants by a committed seed."""

from __future__ import annotations

import random
from pathlib import Path
from typing import NamedTuple

from bench.reliability.code_mutants.operators import Site, describe, find_sites

ROOT = Path(__file__).parents[3]
SEED = 35


class Group(NamedTuple):
    """Modules from which mutants are drawn together.

    patterns: globs relative to the root of the repository.
    fraction: part of the draw, 0 to 1.
    """

    patterns: tuple[str, ...]
    fraction: float


def _list(folder: str, *names: str) -> tuple[str, ...]:
    """The paths of modules of a folder."""
    return tuple(f"{folder}/{name}.py" for name in names)


#: The modules between the paths and the text. Left out are `lower/edges`, `order/edges` and
#: `order/arm`, which need an arm, `lower/replay`, which needs a program as input, and
#: `order/solver`, `search`, `proven` and `tree`, which find an order and change no path.
PROGRAM_GROUPS = {
    "posts": Group(
        ("postprocessors/*.py", *_list("postprocessors", "pacscript/*", "rapid/*", "vplus/*")), 0.4
    ),
    "passes": Group(_list("camgen/post", "passes", "__init__", "printed", "replacement"), 0.1),
    "lower": Group(
        (
            "camgen/motion/corners.py",
            *_list("camgen/lower", "columns", "contours", "draft", "runs", "steps"),
        ),
        0.25,
    ),
    "order": Group(
        _list(
            "camgen/order",
            *("__init__", "arrange", "leads", "pieces", "starts", "stay_down", "tabs", "tours"),
        ),
        0.25,
    ),
}
#: Core modules, whose mutants the tests of their folder have to find.
CORE_GROUPS = {
    "geometry": Group(("camgen/geometry/offset.py", "camgen/geometry/arcs.py"), 0.2),
    "plan": Group(
        ("camgen/plan/beside.py", "camgen/plan/columns.py", "camgen/plan/follow.py"), 0.15
    ),
    "order": Group(("camgen/order/leads.py", "camgen/order/tabs.py"), 0.15),
    "lower": Group(("camgen/lower/contours.py", "camgen/lower/runs.py"), 0.15),
    "stock": Group(("camgen/check/stock/*.py",), 0.2),
    "kinematics": Group(("camgen/robots/kinematics/*.py",), 0.15),
}


class Mutant(NamedTuple):
    """A module with one change. module: its path relative to the root, with slashes."""

    group: str
    module: str
    site: Site

    @property
    def name(self) -> str:
        """The name by which a table and `--only` refer to it."""
        site = self.site
        return f"{self.module}:{site.line}:{site.operator}:{site.slot}.{site.variant}"

    @property
    def source(self) -> str:
        """The module as it stands."""
        return (ROOT / self.module).read_text(encoding="utf-8")

    def describe(self) -> tuple[str, str]:
        """The changed piece of code before and after."""
        return describe(self.source, self.site)


def list_modules(group: Group) -> list[str]:
    """The modules of a group, in order of name."""
    names: set[str] = set()
    for pattern in group.patterns:
        names.update(path.relative_to(ROOT).as_posix() for path in ROOT.glob(pattern))
    return sorted(names)


def draw(groups: dict[str, Group], count: int, seed: int = SEED) -> list[Mutant]:
    """Mutants drawn by seed, in a random order, so that the first hundred are a fair sample.

    In each group, the operator is drawn first and a place of it then: numbers and calls are so
    frequent that a plain draw would leave out most other operators.
    """
    generator = random.Random(seed)
    drawn: list[Mutant] = []
    for name, group in groups.items():
        drawn += _draw_group(name, group, round(count * group.fraction), generator)
    generator.shuffle(drawn)
    return drawn


def _draw_group(name: str, group: Group, count: int, generator: random.Random) -> list[Mutant]:
    by_operator: dict[str, list[Mutant]] = {}
    for module in list_modules(group) if count else ():
        for site in find_sites((ROOT / module).read_text(encoding="utf-8")):
            by_operator.setdefault(site.operator, []).append(Mutant(name, module, site))
    drawn: list[Mutant] = []
    while len(drawn) < count and by_operator:
        operator = generator.choice(sorted(by_operator))
        mutants = by_operator[operator]
        drawn.append(mutants.pop(generator.randrange(len(mutants))))
        if not mutants:
            del by_operator[operator]
    return drawn
