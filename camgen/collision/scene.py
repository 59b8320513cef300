"""What can collide: the bodies of a cell, and which pairs of them are tested.

Links, tool, fixtures and table are cuboids (RFA paper, section II.B); the part is a mesh or cuboids.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
from msgspec import Struct

from camgen.collision.mesh import Mesh, join_surfaces
from camgen.collision.pairs import (
    MeshPair,
    Shape,
    Sweep,
    box_part,
    link_points,
    model_of,
    pair_up,
)
from camgen.collision.swept import enlarge_levers, measure_roundness, sweep
from camgen.geometry.vectors import cross
from camgen.model.errors import JobError
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, Vec3, frozen, to_vec3, translation
from camgen.model.text import short, suggest
from camgen.robots.models import Box, Link, Robot

#: The name of the part among the bodies.
PART = "part"
_HERE = Pose(IDENTITY, (0.0, 0.0, 0.0))


class Target(Struct, frozen=True, eq=False):
    """A mesh that stands. striking, of_strike: (M,) boxes of the scene that are tested against it and their pair."""

    mesh: Mesh
    base_from_mesh: Pose
    striking: IntArray
    of_strike: IntArray


class Scene(Struct, frozen=True, eq=False):
    """A cell ready to be tested. Made by ``scene``.

    pairs: names of the bodies of every pair, in the order in which they are tested: the robot and its tool against
    themselves, then against obstacles, then against the part.

    Boxes, B in all, some bodies with more than one set of them: frame: (B,) the link that carries it, 0 for what
    stands; rotation (B, 3, 3), origin (B, 3): link_from_box; half: (B, 3).
    first, second, of_pair: (P,) boxes that are tested against each other and their pair.
    targets: meshes that stand.
    closer: the meshes of each pair, which decide where boxes meet, None for two bodies of boxes.
    """

    robot: Robot
    pairs: tuple[tuple[str, str], ...]
    frame: IntArray
    rotation: FloatArray
    origin: FloatArray
    half: FloatArray
    first: IntArray
    second: IntArray
    of_pair: IntArray
    targets: tuple[Target, ...]
    closer: tuple[MeshPair | None, ...]

    @property
    def moving(self) -> BoolArray:
        """(B,) which boxes move."""
        return self.frame > 0


def name_pair(scene: Scene, pair: int) -> str:
    """The pair that ``hits`` names, as text: 'link 5 against clamp'."""
    return " against ".join(scene.pairs[pair])


class _Body(Struct, frozen=True, eq=False):
    """A name and its boxes in the frame of link ``frame``.

    link: link whose meshes decide where boxes meet.
    """

    name: str
    frame: int
    boxes: tuple[Box, ...]
    mesh: Mesh | None = None
    base_from_mesh: Pose = _HERE
    link: Link | None = None

    def measure_reach(self, origin: FloatArray, axis: FloatArray) -> tuple[float, float]:
        """The reach of the body from an axis and from a point on it, mm.

        origin: (3,) the point, in the frame of the link.
        axis: (3,) direction, a unit vector.
        """
        if self.link is not None:
            return _measure_link(self.link, to_vec3(origin), to_vec3(axis))
        if self.mesh is None:
            return _measure_reach(np.concatenate([*map(_corners, self.boxes)]) - origin, axis)
        place, corners = self.base_from_mesh, self.mesh.tree.corners.reshape(-1, 3)
        placed = corners @ place.rotation.T + np.asarray(place.origin)
        return _measure_reach(placed - origin, axis)

    def shape(self) -> Shape:
        """The body as fcl has it."""
        if self.mesh is not None:
            place = self.base_from_mesh
            points = self.mesh.outermost @ place.rotation.T + np.asarray(place.origin)
            around = self.mesh.box
            box = Box(place @ translation(*to_vec3(around.centres)), to_vec3(around.half))
            return Shape(self.frame, ((self.mesh.model, place),), points, (box,))
        if self.link is not None:
            return _shape_link(self.link, self.frame)
        points = np.concatenate([*map(_corners, self.boxes)])
        parts = tuple(map(box_part, self.boxes))
        return Shape(self.frame, parts, points, self.boxes, is_mesh=False)


class Wall(Struct, frozen=True, eq=False):
    """A body that stands and is a mesh, in the frame of the mesh."""

    name: str
    mesh: Mesh
    base_from_mesh: Pose


class Allowed(Struct, frozen=True):
    """Contacts that the collision test permits.

    contact: mm that the first body of the tool may enter the part.
    tip: mm that its tip may enter the part beyond that: the last of its boxes' z, as long as half
        their width.
    pairs: pairs of names of bodies that are not tested.
    """

    contact: float = 0.0
    tip: float = 0.0
    pairs: tuple[tuple[str, str], ...] = ()


def scene(
    robot: Robot,
    tool: tuple[Link, ...] = (),
    obstacles: tuple[Link | Wall, ...] = (),
    part: Mesh | tuple[Box, ...] = (),
    base_from_part: Pose = _HERE,
    allowed: Allowed = Allowed(),  # noqa: B008 (frozen)
) -> Scene:
    """A scene. tool: bodies fixed to the flange, their boxes as flange_from_box; obstacles: bodies that stand, their
    boxes as base_from_box; part: its boxes as part_from_box, or its mesh.

    Links are grown by the robot's pad. Links that touch anyway (``Robot.touching``) are not tested against each other,
    nor the tool against the last link; links that touch the last one, to which the flange may be closer than the pad,
    are tested against the tool without pad. The base stands: it is tested against what moves only.

    JobError: two bodies of one name, a name in ``allowed`` that no body has, a tool thinner than its contact.
    """
    last = len(robot.joints)
    bare = [
        _Body(link.name, k, link.boxes, link=link if link.surfaces else None)
        for k, link in enumerate(robot.links)
    ]
    links = [
        _Body(body.name, body.frame, _grow(body.boxes, robot.pad), link=body.link) for body in bare
    ]
    tools = [_Body(body.name, last, _on_flange(robot, body.boxes)) for body in tool]
    standing = [_stand(body) for body in obstacles]
    target = _part(part, base_from_part)
    _check([*links, *tools, *standing, *target], allowed.pairs)
    spared = {frozenset(pair) for pair in robot.touching}
    pairs = [
        (a, b)
        for a, b in itertools.combinations(links, 2)
        if frozenset((a.frame, b.frame)) not in spared
    ]
    pairs += [
        ((bare if frozenset((k, last)) in spared else links)[k], body)
        for body in tools
        for k in range(last)
    ]
    pairs += [(body, other) for body in [*links[1:], *tools] for other in standing]
    working = [
        *(_Body(body.name, last, _entering(body, allowed)) for body in tools[:1]),
        *tools[1:],
    ]
    pairs += [(body, other) for body in [*links[1:], *working] for other in target]
    without = {frozenset(names) for names in allowed.pairs}
    tested = [(a, b) for a, b in pairs if frozenset((a.name, b.name)) not in without]
    return _tabulate(robot, tested)


def narrow(scene: Scene, pairs: Sequence[int]) -> Scene:
    """The same cell with only these of its pairs, by index, and only their boxes."""
    number = np.full(len(scene.pairs), -1)
    number[list(pairs)] = np.arange(len(pairs))
    tested = number[scene.of_pair] >= 0
    strikes = [(target, number[target.of_strike] >= 0) for target in scene.targets]
    used = np.zeros(len(scene.frame), dtype=bool)
    used[scene.first[tested]] = used[scene.second[tested]] = True
    for target, kept in strikes:
        used[target.striking[kept]] = True
    place = np.cumsum(used) - 1
    return Scene(
        robot=scene.robot,
        pairs=tuple(scene.pairs[k] for k in pairs),
        frame=scene.frame[used],
        rotation=frozen(scene.rotation[used]),
        origin=frozen(scene.origin[used]),
        half=frozen(scene.half[used]),
        first=place[scene.first[tested]],
        second=place[scene.second[tested]],
        of_pair=number[scene.of_pair[tested]],
        targets=tuple(
            Target(
                one.mesh, one.base_from_mesh, place[one.striking[kept]], number[one.of_strike[kept]]
            )
            for one, kept in strikes
            if kept.any()
        ),
        closer=tuple(scene.closer[k] for k in pairs),
    )


def _grow(boxes: tuple[Box, ...], pad: float) -> tuple[Box, ...]:
    return tuple(
        Box(box.link_from_box, (box.half[0] + pad, box.half[1] + pad, box.half[2] + pad))
        for box in boxes
    )


@lru_cache(maxsize=256)
def _measure_link(link: Link, origin: Vec3, axis: Vec3) -> tuple[float, float]:
    return _measure_reach(join_surfaces(link)[0] - np.array(origin), np.array(axis))


def _measure_reach(points: FloatArray, axis: FloatArray) -> tuple[float, float]:
    """The reach of points (N, 3) from an axis through their origin, and from that, mm."""
    across = np.linalg.norm(cross(points, axis), axis=1)
    return float(across.max()), float(np.linalg.norm(points, axis=1).max())


def _corners(box: Box) -> FloatArray:
    """(8, 3) the corners of a cuboid."""
    place, half = box.link_from_box, np.asarray(box.half)
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return np.asarray((signs * half) @ place.rotation.T + np.asarray(place.origin))


def _on_flange(robot: Robot, boxes: tuple[Box, ...]) -> tuple[Box, ...]:
    return tuple(Box(robot.flange @ box.link_from_box, box.half) for box in boxes)


def _stand(body: Link | Wall) -> _Body:
    if isinstance(body, Wall):
        return _Body(body.name, 0, (), body.mesh, body.base_from_mesh)
    return _Body(body.name, 0, body.boxes)


def _entering(body: _Body, allowed: Allowed) -> tuple[Box, ...]:
    contact, tip = allowed.contact, allowed.tip
    thin = min((min(box.half) for box in body.boxes), default=contact + 1)
    if thin <= contact:
        depth, width = short(contact, 3), short(2 * thin, 3)
        remedy = f'allow ("{body.name}", "{PART}") instead' if contact > 0 else "give it a size"
        raise JobError(
            f"tool {body.name}",
            f"it may enter the part by {depth} mm, but is {width} mm thin",
            "",
            remedy,
        )
    entering = _grow(body.boxes, -contact)
    return entering if tip == 0 else tuple(part for box in entering for part in _taper(box, tip))


def _taper(box: Box, tip: float) -> tuple[Box, ...]:
    """The box as two along its z, the last of them, as long as half its width, thinner and shorter by ``tip``."""
    wide, deep, long = box.half
    end = min(wide, deep, long) / 2
    shaft = Box(box.link_from_box @ translation(0.0, 0.0, -end), (wide, deep, long - end))
    if min(wide, deep, 2 * end) <= tip:
        return (shaft,)
    middle = long - end - tip / 2
    return shaft, Box(
        box.link_from_box @ translation(0.0, 0.0, middle), (wide - tip, deep - tip, end - tip / 2)
    )


def _part(part: Mesh | tuple[Box, ...], base_from_part: Pose) -> list[_Body]:
    if isinstance(part, Mesh):
        return [_Body(PART, 0, (), part, base_from_part)]
    boxes = tuple(Box(base_from_part @ box.link_from_box, box.half) for box in part)
    return [_Body(PART, 0, boxes)] if boxes else []


def _check(bodies: list[_Body], allowed: tuple[tuple[str, str], ...]) -> None:
    names = [body.name for body in bodies]
    for name in names:
        if names.count(name) > 1:
            raise JobError(f"body {name}", "there are two of this name", remedy="rename one")
    for name in itertools.chain.from_iterable(allowed):
        if name not in names:
            what = "it may touch, but there is no such body"
            raise JobError(f"body {name}", what, remedy=suggest(name, names))


def _tabulate(robot: Robot, tested: list[tuple[_Body, _Body]]) -> Scene:
    rows: dict[int, range] = {}
    bodies: list[_Body] = []
    for body in itertools.chain.from_iterable(tested):
        if id(body) not in rows:
            begin = sum(len(other.boxes) for other in bodies)
            rows[id(body)] = range(begin, begin + len(body.boxes))
            bodies.append(body)
    boxes = [(body.frame, box) for body in bodies for box in body.boxes]
    against = [
        (i, j, k) for k, (a, b) in enumerate(tested) for i in rows[id(a)] for j in rows[id(b)]
    ]
    first, second, of_pair = np.array(against, dtype=np.int64).reshape(-1, 3).T
    return Scene(
        robot=robot,
        pairs=tuple((a.name, b.name) for a, b in tested),
        frame=np.array([frame for frame, _ in boxes], dtype=np.int64),
        rotation=frozen(np.reshape([box.link_from_box.rotation for _, box in boxes], (-1, 3, 3))),
        origin=frozen(np.reshape([box.link_from_box.origin for _, box in boxes], (-1, 3))),
        half=frozen(np.reshape([box.half for _, box in boxes], (-1, 3))),
        first=first,
        second=second,
        of_pair=of_pair,
        targets=tuple(_target(body, tested, rows) for body in bodies if body.mesh),
        closer=tuple(_closer(robot, a, b) for a, b in tested),
    )


def _closer(robot: Robot, first: _Body, second: _Body) -> MeshPair | None:
    """The meshes of a pair, None if no link of it has any, or if one body has no shape at all."""
    if first.link is None and second.link is None:
        return None
    if not all(body.boxes or body.mesh for body in (first, second)):
        return None
    if first.link is not None and second.link is not None:
        return _pair_links(robot, (first.link, first.frame), (second.link, second.frame))
    return pair_up(first.shape(), second.shape(), _levers_between(robot, first, second))


#: A link that is a mesh, and its number.
_NumberedLink = tuple[Link, int]


@lru_cache(maxsize=128)
def _pair_links(robot: Robot, first: _NumberedLink, second: _NumberedLink) -> MeshPair:
    """The pair of two links, with its known distances, for any number of scenes."""
    body, second_body = (
        _Body(link.name, frame, link.boxes, link=link) for link, frame in (first, second)
    )
    levers = _levers_between(robot, body, second_body)
    wider = cache(lambda: _widen(robot, first, second, levers))
    return pair_up(body.shape(), second_body.shape(), levers, wider)


def _widen(
    robot: Robot, first: _NumberedLink, second: _NumberedLink, levers: FloatArray
) -> MeshPair | None:
    """The pair of two links with one link between them, the rounder one as the solid it sweeps.

    With one joint left there are few cells. None for other links, and where no joint turns.
    """
    if second[1] - first[1] != 2:
        return None
    after, before = robot.joints[first[1] : second[1]]
    place = after.previous_from_joint
    choices = []
    if not after.sliding:
        about = place.origin, to_vec3(place.rotation @ np.asarray(after.axis))
        choices.append((measure_roundness(first[0], *about), first, second, about))
    if not before.sliding:
        about = _HERE.origin, before.axis
        choices.append((measure_roundness(second[0], *about), second, first, about))
    if not choices:
        return None
    _, (link, frame), (other, other_frame), about = min(choices, key=lambda choice: choice[0])
    solid, (points, _) = sweep(link, *about), join_surfaces(other)
    # The solid holds its link, so the points of that are in it.
    swept = Shape(frame, ((solid.model, _HERE),), link_points(link), ())
    other_shape = _shape_link(other, other_frame)
    is_first = frame < other_frame
    return pair_up(
        swept if is_first else other_shape,
        other_shape if is_first else swept,
        enlarge_levers(levers),
        sweep=Sweep(solid, is_first, points),
    )


def _shape_link(link: Link, frame: int) -> Shape:
    return Shape(frame, ((model_of(link), _HERE),), link_points(link), link.boxes)


def _levers_between(robot: Robot, first: _Body, second: _Body) -> FloatArray:
    """(J,) mm per rad or mm of each joint by which two bodies come nearer at most.

    To turn one body about a joint is to turn the other one the other way, so the less distant
    counts. No point of a body is farther from the axis of the joint than the lever.
    """
    near, far = sorted((first, second), key=lambda body: body.frame)
    between = slice(near.frame, far.frame)
    joints = robot.joints[between]
    levers = np.zeros(len(robot.joints))
    if not joints:
        return levers
    sliding = np.array([joint.sliding for joint in joints])
    travel = (np.abs(robot.coupling) @ np.abs(robot.limits).max(axis=1))[between] * sliding
    shifts = np.array([joint.previous_from_joint.origin for joint in joints])
    axes = np.array([joint.axis for joint in joints], dtype=np.float64)
    turned = np.array(
        [joint.previous_from_joint.rotation @ joint.axis for joint in joints], dtype=np.float64
    )
    outward = _sum_levers(near.measure_reach(shifts[0], turned[0]), turned, shifts[1:], travel)
    inward = _sum_levers(
        far.measure_reach(np.zeros(3), axes[-1]), axes[::-1], shifts[:0:-1], travel[::-1]
    )
    levers[between] = np.where(sliding, 1.0, np.minimum(outward, inward[::-1]))
    return levers


def _sum_levers(
    reach_at_first: tuple[float, float], axes: FloatArray, shifts: FloatArray, travel: FloatArray
) -> FloatArray:
    """The reach of a body from each of K axes at any joint values (K,), mm.

    reach_at_first: reach from the first axis and from its origin, mm.
    axes: (K, 3) unit vectors.
    shifts: (K - 1, 3) from the origin of each axis to that of the next one, mm.
    travel: (K,) mm by which a sliding joint moves the links beyond it, 0 for others.
    """
    distances, reach = [reach_at_first[0]], reach_at_first[1] + travel[0]
    for axis, shift, slide in zip(axes[1:], shifts, travel[1:], strict=True):
        distances.append(float(np.linalg.norm(np.cross(shift, axis))) + reach)
        reach += float(np.linalg.norm(shift)) + slide
    return np.array(distances)


def _target(body: _Body, tested: list[tuple[_Body, _Body]], rows: dict[int, range]) -> Target:
    assert body.mesh is not None
    strikes = [(i, k) for k, (a, b) in enumerate(tested) if b is body for i in rows[id(a)]]
    striking, of_strike = np.array(strikes, dtype=np.int64).reshape(-1, 2).T
    return Target(body.mesh, body.base_from_mesh, striking, of_strike)
