"""Faults seeded in programs: which harm the part or the tool, and which of them the stock proof finds.

python -m bench.check.stock_faults [N, 1000] [SEED, 1]
"""

from __future__ import annotations

import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from bench.check.judge import Judge
from bench.check.scenes import Scene, move_poses, scenes
from bench.support.runner import open_table, read_words
from camgen.check.stock import Cut, StockProof, prove
from camgen.model.pose import Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL

COLUMNS = (
    "fault | seeded | harmful | of these found | missed | harmless | of these reported "
    "| deepest of these mm {:.3f}"
)
Body = list[Instruction]
#: A fault: the cuts with it; None if the scene has nothing of the kind.
Seed = Callable[[Scene, random.Random], tuple[Cut, ...] | None]
#: Whether a fault may be at a place of a body.
IsPlace = Callable[[Body, int], bool]


def _moved(item: Instruction, dx: float, dy: float, dz: float = 0.0) -> Instruction:
    return move_poses(item, lambda x, y, z: (x + dx, y + dy, z + dz))


def _height(item: Instruction) -> float:
    target = getattr(item, "target", None)
    return target.origin[2] if isinstance(target, Pose) else 1e9


def _with(scene: Scene, number: int, body: Sequence[Instruction]) -> tuple[Cut, ...]:
    cut = replace(scene.cuts[number], body=tuple(body), lines=range(1, len(body) + 1))
    return (*scene.cuts[:number], cut, *scene.cuts[number + 1 :])


def _pick_body(scene: Scene, chance: random.Random) -> tuple[int, Body]:
    """A cut by its number, and its instructions."""
    number = chance.randrange(len(scene.cuts))
    return number, list(scene.cuts[number].body)


def at_place(is_place: IsPlace, change: Callable[[Body, int, random.Random], bool]) -> Seed:
    """The fault that a change makes at one of the places. change: returns whether there is one."""

    def seed(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
        number, body = _pick_body(scene, chance)
        places = [k for k in range(len(body)) if is_place(body, k)]
        is_changed = bool(places) and change(body, chance.choice(places), chance)
        return _with(scene, number, body) if is_changed else None

    return seed


def deep(*kinds: type) -> IsPlace:
    """Whether a motion of these kinds ends in the material."""
    return lambda body, k: isinstance(body[k], kinds) and _height(body[k]) < -1e-6


def is_motion(body: Body, k: int) -> bool:
    return isinstance(body[k], (MoveJ, MoveL, MoveC))


def is_retract(body: Body, k: int) -> bool:
    return k > 0 and isinstance(body[k], MoveJ) and _height(body[k - 1]) < 0 < _height(body[k])


def _size(chance: random.Random, least: float = 0.003, most: float = 4.0) -> float:
    """Small ones as often as large ones."""
    return float(least * (most / least) ** chance.random())


def shift(body: Body, k: int, chance: random.Random) -> bool:
    by, axis = _size(chance) * chance.choice((-1, 1)), chance.randrange(2)
    body[k] = _moved(body[k], by * (axis == 0), by * (axis == 1))
    return True


def turn_round(body: Body, k: int, _chance: random.Random) -> bool:
    """The arc on the other side of its chord: G2 for G3."""
    arc, start = body[k], getattr(body[k - 1], "target", None)
    if not isinstance(start, Pose) or not isinstance(arc, MoveC):
        return False
    a, b, via = (complex(*pose.origin[:2]) for pose in (start, arc.target, arc.via))
    mirrored = a + ((via - a) / (b - a)).conjugate() * (b - a)
    origin = (mirrored.real, mirrored.imag, arc.via.origin[2])
    body[k] = replace(arc, via=replace(arc.via, origin=origin))
    return True


def deepen(body: Body, k: int, chance: random.Random) -> bool:
    """A motion and those after it at the same depth."""
    by, level = -_size(chance) * chance.choice((1, 1, 1, -1)), _height(body[k])
    while k < len(body) and abs(_height(body[k]) - level) < 1e-9:
        body[k] = _moved(body[k], 0, 0, by)
        k += 1
    return True


def leave_out(body: Body, k: int, _chance: random.Random) -> bool:
    """Without a motion that is not the first."""
    if k:
        del body[k]
    return k > 0


def hurry(body: Body, k: int, _chance: random.Random) -> bool:
    """A motion at feed as a rapid one."""
    target = getattr(body[k], "target", None)
    assert isinstance(target, Pose)
    body[k] = MoveJ(target, 100.0)
    return True


def wrong_offset(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    return (chance.choice(scene.others),) if scene.others else None


def wrong_tool(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    number = chance.randrange(len(scene.cuts))
    cut = scene.cuts[number]
    wide = cut.tool.diameter + 2 * _size(chance) * chance.choice((1, 1, -0.1))
    made = replace(cut, tool=replace(cut.tool, diameter=max(wide, 0.5)))
    return (*scene.cuts[:number], made, *scene.cuts[number + 1 :])


def swapped_holes(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """Two paths of a cut, each in the place of the other."""
    number, body = _pick_body(scene, chance)
    runs = _runs(body)
    if len(runs) < 2:
        return None
    one, two = chance.sample(runs, 2)
    first, second = (_middle(body, run) for run in (one, two))
    apart = second[0] - first[0], second[1] - first[1]
    for run, sign in ((one, 1), (two, -1)):
        for k in run:
            body[k] = _moved(body[k], sign * apart[0], sign * apart[1])
    return _with(scene, number, body)


def _runs(body: Body) -> list[list[int]]:
    """The motions from one way above the part to the next."""
    runs: list[list[int]] = []
    going = False
    for k, item in enumerate(body):
        deep = _height(item) < 5.0
        if deep:
            if not going:
                runs.append([])
            runs[-1].append(k)
        going = deep
    return runs


def _middle(body: Body, run: list[int]) -> tuple[float, float]:
    places = [
        pose.origin for k in run if isinstance(pose := getattr(body[k], "target", None), Pose)
    ]
    x, y = [p[0] for p in places], [p[1] for p in places]
    return (min(x) + max(x)) / 2, (min(y) + max(y)) / 2


def left_out_tab(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """One of them, or all."""
    if not scene.tabs:
        return None
    body = list(scene.cuts[0].body)
    deepest = min(map(_height, body))
    last = [
        k
        for k, item in enumerate(body)
        if isinstance(item, MoveL) and abs(_height(item) - deepest - 1) < 1e-9
    ]
    pairs = list(zip(last[::2], last[1::2], strict=True))
    for pair in pairs if chance.random() < 0.5 else [chance.choice(pairs)]:
        for k in pair:
            body[k] = _moved(body[k], 0, 0, -1.0)
    return _with(scene, 0, body)


def outline_first(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """Two paths in the other order."""
    if len(scene.cuts) > 1 and chance.random() < 0.5:
        return tuple(reversed(scene.cuts))
    number, body = _pick_body(scene, chance)
    runs = _runs(body)
    if len(runs) < 2:
        return None
    one, two = sorted(chance.sample(range(len(runs)), 2))
    a, b = runs[one], runs[two]
    swapped = [
        *body[: a[0]],
        *body[b[0] : b[-1] + 1],
        *body[a[-1] + 1 : b[0]],
        *body[a[0] : a[-1] + 1],
    ]
    return _with(scene, number, _lifted([*swapped, *body[b[-1] + 1 :]]))


def _lifted(body: Body) -> Body:
    """With a way up and across wherever a rapid motion would begin or end elsewhere in the material."""
    made: Body = []
    for item in body:
        before = getattr(made[-1], "target", None) if made else None
        target = getattr(item, "target", None)
        if (
            isinstance(before, Pose)
            and isinstance(target, Pose)
            and isinstance(item, (MoveJ, MoveL))
        ):
            away = abs(complex(*before.origin[:2]) - complex(*target.origin[:2])) > 1e-6
            if (
                away
                and (isinstance(item, MoveJ) or before.origin[2] > 0)
                and min(before.origin[2], target.origin[2]) < 10
            ):
                for x, y, _ in (before.origin, target.origin):
                    made.append(MoveJ(replace(target, origin=(x, y, 10.0)), 100.0))
        made.append(item)
    return made


SEEDS: dict[str, Seed] = {
    "a shifted arc": at_place(deep(MoveC), shift),
    "a shifted line": at_place(deep(MoveL), shift),
    "an arc turned round": at_place(deep(MoveC), turn_round),
    "a lost retract": at_place(is_retract, leave_out),
    "a wrong depth": at_place(deep(MoveL, MoveC), deepen),
    "a wrong offset": wrong_offset,
    "another tool": wrong_tool,
    "swapped holes": swapped_holes,
    "a tab left out": left_out_tab,
    "a motion left out": at_place(is_motion, leave_out),
    "a feed as a rapid": at_place(deep(MoveL, MoveC), hurry),
    "another order": outline_first,
}


def found_of(proof: StockProof) -> bool:
    """Whether the proof would refuse the program, or warns of a part that comes loose too early.

    Parts of scenes without tabs may come loose at their last cut.
    """
    cuts_wrong = any(fault.kind not in ("unheld", "loose") for fault in proof.refused)
    is_early = any(piece.again >= 0 or piece.tabs for piece in proof.pieces.loose)
    return cuts_wrong or is_early or bool(proof.pieces.missing)


def main(count: int, seed: int) -> int:
    chance = random.Random(seed)
    every = scenes()
    judges = [Judge(scene) for scene in every]
    for scene, judge in zip(every, judges, strict=True):
        assert not judge.judge(scene.cuts).any, (
            f"{scene.name} harms the part as it is: {judge.judge(scene.cuts)}"
        )
        assert not found_of(prove(scene.cuts, scene.design)), f"{scene.name} is refused as it is"
    tally: dict[str, Counter[str]] = {name: Counter() for name in SEEDS}
    largest = dict.fromkeys(SEEDS, 0.0)
    begun, spent, missed = time.perf_counter(), 0.0, []
    names = list(SEEDS)
    for number in range(count):
        name, cuts = names[number % len(names)], None
        while cuts is None:
            which = chance.randrange(len(every))
            cuts = SEEDS[name](every[which], chance)
        harm = judges[which].judge(cuts)
        start = time.perf_counter()
        proof = prove(cuts, every[which].design)
        spent += time.perf_counter() - start
        found = found_of(proof)
        if not harm.any:
            largest[name] = max([largest[name], *(fault.mm for fault in proof.refused)])
        harmful, reported = "harmful" if harm.any else "harmless", "found" if found else "silent"
        tally[name].update(["seeded", f"{harmful} {reported}"])
        if harm.any and not found:
            missed.append((number, name, every[which].name, harm))
    seconds = time.perf_counter() - begun
    table = open_table(COLUMNS, f"; {seconds:.0f} s, {spent:.0f} s of it the proofs")
    largest["all"] = max(largest.values())
    for name, counts in [*tally.items(), ("all", sum(tally.values(), Counter()))]:
        caught, silent = counts["harmful found"], counts["harmful silent"]
        alarms, quiet = counts["harmless found"], counts["harmless silent"]
        harmful = caught + silent, caught, silent
        table.add(name, counts["seeded"], *harmful, alarms + quiet, alarms, largest[name])
    for one in missed:
        print(*one)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(*read_words(1000, 1)))
