"""Faults seeded in programs: harm to the part or the tool, and findings of the stock proof.

python -m bench.check.stock_faults [N, 1000] [SEED, 1]
"""

from __future__ import annotations

import math
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from bench.check.judge import Judge
from bench.check.scenes import Scene, make_scenes, move_poses
from bench.support.runner import must_be_none, open_table, read_words
from camgen.check.stock import Cut, StockProof, prove
from camgen.model.pose import Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL

COLUMNS = (
    "fault | seeded | harmful | of these found | missed | harmless | of these reported "
    "| deepest of these mm {:.3f}"
)
#: Smallest and largest size of a fault, mm.
LEAST_MM, MOST_MM = 0.003, 4.0
#: Height below which motions belong to one path, and that of links that are put in, mm.
PATH_MM, LINK_MM = 5.0, 10.0
Body = list[Instruction]
#: A fault: the cuts with it; None if the scene has nothing of the kind.
Seed = Callable[[Scene, random.Random], tuple[Cut, ...] | None]
#: Whether a fault may be at an index of a body.
IsPlace = Callable[[Body, int], bool]
#: Changes a body at an index; False if it cannot.
Change = Callable[[Body, int, random.Random], bool]


def _shift(item: Instruction, dx: float, dy: float, dz: float = 0.0) -> Instruction:
    return move_poses(item, lambda x, y, z: (x + dx, y + dy, z + dz))


def _find_target(item: Instruction) -> Pose | None:
    target = getattr(item, "target", None)
    return target if isinstance(target, Pose) else None


def _height(item: Instruction) -> float:
    target = _find_target(item)
    return target.origin[2] if target else 1e9


def _replace_body(scene: Scene, number: int, body: Sequence[Instruction]) -> tuple[Cut, ...]:
    cut = replace(scene.cuts[number], body=tuple(body), lines=range(1, len(body) + 1))
    return (*scene.cuts[:number], cut, *scene.cuts[number + 1 :])


def _pick_body(scene: Scene, chance: random.Random) -> tuple[int, Body]:
    """A cut by its number, and its instructions."""
    number = chance.randrange(len(scene.cuts))
    return number, list(scene.cuts[number].body)


def seed_at(is_place: IsPlace, change: Change) -> Seed:
    """The fault that a change makes at one of the places."""

    def seed(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
        number, body = _pick_body(scene, chance)
        places = [k for k in range(len(body)) if is_place(body, k)]
        is_changed = bool(places) and change(body, chance.choice(places), chance)
        return _replace_body(scene, number, body) if is_changed else None

    return seed


def is_deep(*kinds: type) -> IsPlace:
    """Whether a motion of these kinds ends in the material."""
    return lambda body, k: isinstance(body[k], kinds) and _height(body[k]) < -1e-6


def is_motion(body: Body, k: int) -> bool:
    return isinstance(body[k], (MoveJ, MoveL, MoveC))


def is_retract(body: Body, k: int) -> bool:
    return k > 0 and isinstance(body[k], MoveJ) and _height(body[k - 1]) < 0 < _height(body[k])


def draw_size(chance: random.Random) -> float:
    """The size of a fault, mm; small ones as often as large ones."""
    return float(LEAST_MM * (MOST_MM / LEAST_MM) ** chance.random())


def shift(body: Body, k: int, chance: random.Random) -> bool:
    distance, axis = draw_size(chance) * chance.choice((-1, 1)), chance.randrange(2)
    body[k] = _shift(body[k], distance * (axis == 0), distance * (axis == 1))
    return True


def mirror(body: Body, k: int, _chance: random.Random) -> bool:
    """The arc on the other side of its chord: G2 for G3."""
    arc, start = body[k], _find_target(body[k - 1])
    if start is None or not isinstance(arc, MoveC):
        return False
    a, b, via = (complex(*pose.origin[:2]) for pose in (start, arc.target, arc.via))
    mirrored = a + ((via - a) / (b - a)).conjugate() * (b - a)
    origin = (mirrored.real, mirrored.imag, arc.via.origin[2])
    body[k] = replace(arc, via=replace(arc.via, origin=origin))
    return True


def deepen(body: Body, k: int, chance: random.Random) -> bool:
    """A motion and those after it at the same depth."""
    distance, level = -draw_size(chance) * chance.choice((1, 1, 1, -1)), _height(body[k])
    while k < len(body) and abs(_height(body[k]) - level) < 1e-9:
        body[k] = _shift(body[k], 0, 0, distance)
        k += 1
    return True


def leave_out(body: Body, k: int, _chance: random.Random) -> bool:
    """Without a motion that is not the first."""
    if k:
        del body[k]
    return k > 0


def hurry(body: Body, k: int, _chance: random.Random) -> bool:
    """A motion at feed as a rapid one."""
    body[k] = MoveJ(_find_target(body[k]), 100.0)
    return True


def seed_offset(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    return (chance.choice(scene.others)(),) if scene.others else None


def seed_tool(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    number = chance.randrange(len(scene.cuts))
    cut = scene.cuts[number]
    wide = cut.tool.diameter + 2 * draw_size(chance) * chance.choice((1, 1, -0.1))
    changed = replace(cut, tool=replace(cut.tool, diameter=max(wide, 0.5)))
    return (*scene.cuts[:number], changed, *scene.cuts[number + 1 :])


def swap_holes(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """Two paths of a cut with each other's place."""
    number, body = _pick_body(scene, chance)
    paths = _list_paths(body)
    if len(paths) < 2:
        return None
    first, second = chance.sample(paths, 2)
    distance = np.subtract(_find_middle(body, second), _find_middle(body, first))
    for path, sign in ((first, 1), (second, -1)):
        for k in path:
            body[k] = _shift(body[k], *(sign * distance).tolist())
    return _replace_body(scene, number, body)


def _list_paths(body: Body) -> list[list[int]]:
    """The motions from one link above the part to the next."""
    paths: list[list[int]] = []
    is_running = False
    for k, item in enumerate(body):
        is_low = _height(item) < PATH_MM
        if is_low and not is_running:
            paths.append([])
        if is_low:
            paths[-1].append(k)
        is_running = is_low
    return paths


def _find_middle(body: Body, path: list[int]) -> tuple[float, float]:
    poses = [pose for k in path if (pose := _find_target(body[k]))]
    x, y, _ = zip(*(pose.origin for pose in poses), strict=True)
    return (min(x) + max(x)) / 2, (min(y) + max(y)) / 2


def remove_tabs(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """One tab or all tabs taken away."""
    if not scene.tabs:
        return None
    body = list(scene.cuts[0].body)
    bridge = min(map(_height, body)) + 1
    tops = []
    for k, item in enumerate(body):
        if isinstance(item, MoveL) and abs(_height(item) - bridge) < 1e-9:
            tops.append(k)
    pairs = list(zip(tops[::2], tops[1::2], strict=True))
    for pair in pairs if chance.random() < 0.5 else [chance.choice(pairs)]:
        for k in pair:
            body[k] = _shift(body[k], 0, 0, -1.0)
    return _replace_body(scene, 0, body)


def swap_order(scene: Scene, chance: random.Random) -> tuple[Cut, ...] | None:
    """Two paths in the other order."""
    if len(scene.cuts) > 1 and chance.random() < 0.5:
        return tuple(reversed(scene.cuts))
    number, body = _pick_body(scene, chance)
    paths = _list_paths(body)
    if len(paths) < 2:
        return None
    first, second = sorted(chance.sample(range(len(paths)), 2))
    a, b = ([path[0], path[-1] + 1] for path in (paths[first], paths[second]))
    swapped = body[: a[0]] + body[slice(*b)] + body[a[1] : b[0]] + body[slice(*a)]
    return _replace_body(scene, number, _lift(swapped + body[b[1] :]))


def _lift(body: Body) -> Body:
    """The body with a lift and a link wherever a rapid motion would run across in the material."""
    lifted: Body = []
    for item in body:
        before, target = _find_target(lifted[-1]) if lifted else None, _find_target(item)
        if before and target and isinstance(item, (MoveJ, MoveL)):
            *start, height = before.origin
            *end, other_height = target.origin
            is_across = math.dist(start, end) > 1e-6
            is_link = isinstance(item, MoveJ) or height > 0
            if is_across and is_link and min(height, other_height) < LINK_MM:
                for x, y in (start, end):
                    lifted.append(MoveJ(replace(target, origin=(x, y, LINK_MM)), 100.0))
        lifted.append(item)
    return lifted


SEEDS: dict[str, Seed] = {
    "a shifted arc": seed_at(is_deep(MoveC), shift),
    "a shifted line": seed_at(is_deep(MoveL), shift),
    "a reversed arc": seed_at(is_deep(MoveC), mirror),
    "a lost retract": seed_at(is_retract, leave_out),
    "a wrong depth": seed_at(is_deep(MoveL, MoveC), deepen),
    "a wrong offset": seed_offset,
    "another tool": seed_tool,
    "swapped holes": swap_holes,
    "a tab left out": remove_tabs,
    "a motion left out": seed_at(is_motion, leave_out),
    "a feed as a rapid": seed_at(is_deep(MoveL, MoveC), hurry),
    "another order": swap_order,
}


def has_finding(proof: StockProof) -> bool:
    """Whether the proof would refuse the program, or warns of a part that comes loose too early.

    Parts of scenes without tabs may come loose at their last cut.
    """
    is_wrong = any(fault.kind not in ("unheld", "loose") for fault in proof.refused)
    is_early = any(piece.again >= 0 or piece.tabs for piece in proof.pieces.loose)
    return is_wrong or is_early or bool(proof.pieces.missing)


def draw_fault(
    name: str, scenes: Sequence[Scene], chance: random.Random
) -> tuple[int, tuple[Cut, ...]]:
    """The number of a scene, and its cuts with a fault."""
    while True:
        number = chance.randrange(len(scenes))
        cuts = SEEDS[name](scenes[number], chance)
        if cuts is not None:
            return number, cuts


def main(count: int, seed: int) -> int:
    """Prints the table, and the faults that are missed; 1 if there is one."""
    chance, scenes = random.Random(seed), make_scenes()
    judges = [Judge(scene) for scene in scenes]
    for scene, points in zip(scenes, judges, strict=True):
        harm = points.measure_harm(scene.cuts)
        assert not harm.any, f"{scene.name} harms the part as it is: {harm}"
        assert not has_finding(prove(scene.cuts, scene.design)), f"{scene.name} is refused as it is"
    tally: dict[str, Counter[str]] = {name: Counter() for name in SEEDS}
    largest = dict.fromkeys(SEEDS, 0.0)
    start, spent, missed = time.perf_counter(), 0.0, []
    names = list(SEEDS)
    for number in range(count):
        name = names[number % len(names)]
        which, cuts = draw_fault(name, scenes, chance)
        harm = judges[which].measure_harm(cuts)
        proof_start = time.perf_counter()
        proof = prove(cuts, scenes[which].design)
        spent += time.perf_counter() - proof_start
        is_reported = has_finding(proof)
        if not harm.any:
            largest[name] = max([largest[name], *(fault.mm for fault in proof.refused)])
        tally[name].update(["seeded", f"{harm.any} {is_reported}"])
        if harm.any and not is_reported:
            missed.append((number, name, scenes[which].name, harm))
    seconds = time.perf_counter() - start
    table = open_table(COLUMNS, f"; {seconds:.0f} s, {spent:.0f} s of it the proofs")
    largest["all"] = max(largest.values())
    for name, counts in [*tally.items(), ("all", sum(tally.values(), Counter()))]:
        caught, silent, alarms = counts["True True"], counts["True False"], counts["False True"]
        harmful = caught + silent, caught, must_be_none(silent)
        harmless = alarms + counts["False False"], alarms, largest[name]
        table.add(name, counts["seeded"], *harmful, *harmless)
    for row in missed:
        print(*row)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(1000, 1)))
