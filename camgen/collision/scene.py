"""The bodies of a cell that can collide, and the pairs of them that are tested.

Links, tool, fixtures and table are cuboids (RFA paper, section II.B). Where the cuboids of a link
meet others, its meshes decide, if it has any. The part is a mesh or cuboids.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from functools import cache, cached_property, lru_cache, partial

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.boxes import Boxes
from camgen.collision.mesh import Mesh, join_surfaces, make_model, select_outermost
from camgen.collision.pairs import (
    MeshPair,
    Shape,
    Sweep,
    make_box_part,
    make_pair,
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
_NO_SHIFT = Pose(IDENTITY, (0.0, 0.0, 0.0))


class Target(Struct, frozen=True, eq=False, dict=True):
    """A mesh that stands.

    striking: (M,) indices of the boxes of the scene that are tested against it.
    of_strike: (M,) index in `Scene.pairs` of each of these tests.
    """

    mesh: Mesh
    base_from_mesh: Pose
    striking: IntArray
    of_strike: IntArray

    @cached_property
    def box(self) -> Boxes:
        """The box around the mesh, in the base frame."""
        frame, box = self.base_from_mesh, self.mesh.box
        centre = frame.rotation @ box.centres + np.asarray(frame.origin)
        return Boxes(centre, frame.rotation, box.half)


class Scene(Struct, frozen=True, eq=False):
    """A cell ready to be tested, made by `make_scene`.

    pairs: names of the two bodies of each pair, in the order in which they are tested: the robot
        and its tool against themselves, then against obstacles, then against the part.
    frame: (B,) index of the link that carries each box, 0 for boxes that stand. Some bodies have
        several sets of boxes.
    rotation, origin: (B, 3, 3) and (B, 3) link_from_box of each box, mm.
    half: (B, 3) half the edges of each box, mm.
    first, second: (P,) indices of boxes that are tested against each other.
    of_pair: (P,) index in `pairs` of each of these tests.
    targets: meshes that stand.
    closer: meshes of each pair, which decide where its boxes meet; None for two bodies of boxes.
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
        """(B,) whether each box moves."""
        return self.frame > 0


def name_pair(scene: Scene, pair: int) -> str:
    """The bodies of a pair, by its index in `scene.pairs`: 'link 5 against clamp'."""
    return " against ".join(scene.pairs[pair])


class _Body(Struct, frozen=True, eq=False):
    """A body of the scene.

    frame: index of the link that carries it, 0 for a body that stands.
    boxes: its cuboids in the frame of that link.
    mesh: its mesh, if it stands and has no boxes.
    link: the link whose meshes decide where the boxes meet.
    """

    name: str
    frame: int
    boxes: tuple[Box, ...]
    mesh: Mesh | None = None
    base_from_mesh: Pose = _NO_SHIFT
    link: Link | None = None

    def measure_reach(self, origin: FloatArray, axis: FloatArray) -> tuple[float, float]:
        """The largest distance of the body from an axis, and from a point on the axis, mm.

        origin: (3,) the point, in the frame of the link.
        axis: (3,) direction of the axis, a unit vector.
        """
        if self.link is not None:
            return _measure_link(self.link, to_vec3(origin), to_vec3(axis))
        if self.mesh is None:
            return _measure_reach(np.concatenate([*map(_corners, self.boxes)]) - origin, axis)
        place, corners = self.base_from_mesh, self.mesh.tree.corners.reshape(-1, 3)
        return _measure_reach(corners @ place.rotation.T + np.asarray(place.origin) - origin, axis)

    def shape(self) -> Shape:
        """The body for fcl."""
        if self.mesh is not None:
            place = self.base_from_mesh
            points = self.mesh.outermost @ place.rotation.T + np.asarray(place.origin)
            around = self.mesh.box
            box = Box(place @ translation(*to_vec3(around.centres)), to_vec3(around.half))
            return Shape(self.frame, ((self.mesh.model, place),), points, (box,))
        if self.link is not None:
            return _shape_link(self.link, self.frame)
        points = np.concatenate([*map(_corners, self.boxes)])
        parts = tuple(map(make_box_part, self.boxes))
        return Shape(self.frame, parts, points, self.boxes, is_mesh=False)


class StandingMesh(Struct, frozen=True, eq=False):
    """A body that stands and is a mesh."""

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


def make_scene(
    robot: Robot,
    tool: tuple[Link, ...] = (),
    obstacles: tuple[Link | StandingMesh, ...] = (),
    part: Mesh | tuple[Box, ...] = (),
    base_from_part: Pose = _NO_SHIFT,
    allowed: Allowed = Allowed(),  # noqa: B008 (frozen)
) -> Scene:
    """The scene of a robot and its surroundings.

    tool: bodies fixed to the flange, their boxes as flange_from_box.
    obstacles: bodies that stand, their boxes as base_from_box.
    part: its mesh, or its boxes as part_from_box.
    allowed: contacts that are not collisions.

    Links are grown by the pad of the robot. Links that always touch (`Robot.touching`) are not
    tested against each other, and the tool is not tested against the last link. Links that touch
    the last one may be nearer to the flange than the pad, so they are tested against the tool
    without it. The base stands, so it is tested against moving bodies only.

    Raises JobError for two bodies of one name, for a name in `allowed` that no body has, and for a
    tool that is thinner than its contact.
    """
    last = len(robot.joints)
    bare = list(map(_make_link_body, robot.links, range(last + 1)))
    links = [replace(body, boxes=_grow(body.boxes, robot.pad)) for body in bare]
    tools = [_Body(body.name, last, _place_boxes(robot.flange, body.boxes)) for body in tool]
    standing = list(map(_make_standing, obstacles))
    target = _make_part(part, base_from_part)
    _check_names([*links, *tools, *standing, *target], allowed.pairs)
    touching = set(map(frozenset, robot.touching))
    pairs = [
        (a, b)
        for a, b in itertools.combinations(links, 2)
        if frozenset((a.frame, b.frame)) not in touching
    ]
    by_tool = [bare[k] if frozenset((k, last)) in touching else links[k] for k in range(last)]
    pairs += [(link, body) for body, link in itertools.product(tools, by_tool)]
    pairs += itertools.product([*links[1:], *tools], standing)
    working = [_Body(body.name, last, _shrink_tool(body, allowed)) for body in tools[:1]]
    pairs += itertools.product([*links[1:], *working, *tools[1:]], target)
    untested = set(map(frozenset, allowed.pairs))
    return _make_scene(
        robot, [(a, b) for a, b in pairs if frozenset((a.name, b.name)) not in untested]
    )


def select_pairs(scene: Scene, pairs: Sequence[int]) -> Scene:
    """The scene with only these of its pairs, by index, and only their boxes."""
    new_pair = np.full(len(scene.pairs), -1)
    new_pair[list(pairs)] = np.arange(len(pairs))
    is_tested = new_pair[scene.of_pair] >= 0
    is_used = np.zeros(len(scene.frame), dtype=bool)
    is_used[scene.first[is_tested]] = is_used[scene.second[is_tested]] = True
    for target in scene.targets:
        is_used[target.striking[new_pair[target.of_strike] >= 0]] = True
    new_box = np.cumsum(is_used) - 1
    targets = []
    for target in scene.targets:
        kept = np.flatnonzero(new_pair[target.of_strike] >= 0)
        if len(kept):
            strikes = new_box[target.striking[kept]], new_pair[target.of_strike[kept]]
            targets.append(Target(target.mesh, target.base_from_mesh, *strikes))
    return Scene(
        robot=scene.robot,
        pairs=tuple(scene.pairs[k] for k in pairs),
        frame=scene.frame[is_used],
        rotation=frozen(scene.rotation[is_used]),
        origin=frozen(scene.origin[is_used]),
        half=frozen(scene.half[is_used]),
        first=new_box[scene.first[is_tested]],
        second=new_box[scene.second[is_tested]],
        of_pair=new_pair[scene.of_pair[is_tested]],
        targets=tuple(targets),
        closer=tuple(scene.closer[k] for k in pairs),
    )


def _grow(boxes: tuple[Box, ...], pad: float) -> tuple[Box, ...]:
    return tuple(Box(box.link_from_box, to_vec3(np.asarray(box.half) + pad)) for box in boxes)


@lru_cache(maxsize=256)
def _measure_link(link: Link, origin: Vec3, axis: Vec3) -> tuple[float, float]:
    return _measure_reach(join_surfaces(link)[0] - np.array(origin), np.array(axis))


def _measure_reach(points: FloatArray, axis: FloatArray) -> tuple[float, float]:
    """The largest distance of points (N, 3) from an axis through the origin, and from that, mm."""
    across = np.linalg.norm(cross(points, axis), axis=1)
    return float(across.max()), float(np.linalg.norm(points, axis=1).max())


def _corners(box: Box) -> FloatArray:
    """(8, 3) corners of a cuboid in the frame of its link."""
    place, half = box.link_from_box, np.asarray(box.half)
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return np.asarray((signs * half) @ place.rotation.T + np.asarray(place.origin))


def _place_boxes(frame: Pose, boxes: tuple[Box, ...]) -> tuple[Box, ...]:
    return tuple(Box(frame @ box.link_from_box, box.half) for box in boxes)


def _make_link_body(link: Link, frame: int) -> _Body:
    return _Body(link.name, frame, link.boxes, link=link if link.surfaces else None)


def _make_standing(body: Link | StandingMesh) -> _Body:
    if isinstance(body, StandingMesh):
        return _Body(body.name, 0, (), body.mesh, body.base_from_mesh)
    return _Body(body.name, 0, body.boxes)


def _shrink_tool(body: _Body, allowed: Allowed) -> tuple[Box, ...]:
    """The boxes of the tool, smaller by the depth to which it may enter the part.

    Raises JobError if it is not thicker than that.
    """
    contact, tip = allowed.contact, allowed.tip
    thin = min((min(box.half) for box in body.boxes), default=contact + 1)
    if thin <= contact:
        remedy = f'allow ("{body.name}", "{PART}") instead' if contact > 0 else "give it a size"
        raise JobError(
            f"tool {body.name}",
            f"it may enter the part by {short(contact, 3)} mm, but is only "
            f"{short(2 * thin, 3)} mm thick",
            remedy=remedy,
        )
    boxes = _grow(body.boxes, -contact)
    if tip == 0:
        return boxes
    return tuple(itertools.chain.from_iterable(_taper(box, tip) for box in boxes))


def _taper(box: Box, tip: float) -> tuple[Box, ...]:
    """The box as a shaft and an end along its z; the end is thinner and shorter by `tip` mm.

    The end is as long as half the width of the box. An end that vanishes is left out.
    """
    x, y, z = box.half
    end = min(x, y, z) / 2
    shaft = Box(box.link_from_box @ translation(0.0, 0.0, -end), (x, y, z - end))
    if min(x, y, 2 * end) <= tip:
        return (shaft,)
    middle = z - end - tip / 2
    half = (x - tip, y - tip, end - tip / 2)
    return shaft, Box(box.link_from_box @ translation(0.0, 0.0, middle), half)


def _make_part(part: Mesh | tuple[Box, ...], base_from_part: Pose) -> list[_Body]:
    if isinstance(part, Mesh):
        return [_Body(PART, 0, (), part, base_from_part)]
    return [_Body(PART, 0, _place_boxes(base_from_part, part))] if part else []


def _check_names(bodies: list[_Body], allowed: tuple[tuple[str, str], ...]) -> None:
    names = [body.name for body in bodies]
    for name in names:
        if names.count(name) > 1:
            raise JobError(f"body {name}", "there are two of this name", remedy="rename one")
    for name in itertools.chain.from_iterable(allowed):
        if name not in names:
            raise JobError(
                f"body {name}",
                "it may touch, but there is no such body",
                remedy=suggest(name, names),
            )


def _make_scene(robot: Robot, tested: list[tuple[_Body, _Body]]) -> Scene:
    """The scene of pairs of bodies. A body that is in several pairs gets its boxes once."""
    bodies = {id(body): body for body in itertools.chain.from_iterable(tested)}
    rows: dict[int, range] = {}
    boxes: list[tuple[int, Box]] = []
    for number, body in bodies.items():
        rows[number] = range(len(boxes), len(boxes) + len(body.boxes))
        boxes += itertools.product([body.frame], body.boxes)
    box_pairs: list[tuple[int, int, int]] = []
    strikes: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for k, (a, b) in enumerate(tested):
        box_pairs += itertools.product(rows[id(a)], rows[id(b)], [k])
        strikes[id(b)] += itertools.product(rows[id(a)], [k])
    first, second, of_pair = np.array(box_pairs, dtype=np.int64).reshape(-1, 3).T
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
        targets=tuple(_make_target(body, strikes[k]) for k, body in bodies.items() if body.mesh),
        closer=tuple(itertools.starmap(partial(_pair_meshes, robot), tested)),
    )


def _make_target(body: _Body, strikes: list[tuple[int, int]]) -> Target:
    assert body.mesh is not None
    striking, of_strike = np.array(strikes, dtype=np.int64).reshape(-1, 2).T
    return Target(body.mesh, body.base_from_mesh, striking, of_strike)


def _pair_meshes(robot: Robot, first: _Body, second: _Body) -> MeshPair | None:
    """The meshes of a pair, None if no link of it has any, or if one body has no shape at all."""
    has_shapes = (first.boxes or first.mesh) and (second.boxes or second.mesh)
    if (first.link is None and second.link is None) or not has_shapes:
        return None
    if first.link is not None and second.link is not None:
        return _pair_links(robot, (first.link, first.frame), (second.link, second.frame))
    return make_pair(first.shape(), second.shape(), _bound_levers(robot, first, second))


#: A link with meshes, and its index.
_NumberedLink = tuple[Link, int]


@lru_cache(maxsize=128)
def _pair_links(robot: Robot, first: _NumberedLink, second: _NumberedLink) -> MeshPair:
    """The meshes of two links, with their known distances, for any number of scenes."""
    first_body, second_body = _make_link_body(*first), _make_link_body(*second)
    levers = _bound_levers(robot, first_body, second_body)
    wider = cache(lambda: _widen(robot, first, second, levers))
    return make_pair(first_body.shape(), second_body.shape(), levers, wider)


def _widen(
    robot: Robot, first: _NumberedLink, second: _NumberedLink, levers: FloatArray
) -> MeshPair | None:
    """The pair of two links with one link between them, the rounder one as the solid it sweeps.

    The distance then depends on one joint only, so there are few cells. Returns None for other
    links, and if neither joint is revolute.
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
        about = _NO_SHIFT.origin, before.axis
        choices.append((measure_roundness(second[0], *about), second, first, about))
    if not choices:
        return None
    _, (link, frame), (other, other_frame), about = min(choices, key=lambda choice: choice[0])
    solid, (points, _) = sweep(link, *about), join_surfaces(other)
    # The solid holds its link, so the points of the link are in it.
    swept = replace(_shape_link(link, frame), parts=((solid.model, _NO_SHIFT),), boxes=())
    other_shape = _shape_link(other, other_frame)
    is_first = frame < other_frame
    return make_pair(
        swept if is_first else other_shape,
        other_shape if is_first else swept,
        enlarge_levers(levers),
        sweep=Sweep(solid, is_first, points),
    )


@lru_cache(maxsize=64)
def _shape_link(link: Link, frame: int) -> Shape:
    """All surfaces of a link for fcl, made once for any number of scenes."""
    vertices, faces = join_surfaces(link)
    parts = ((make_model(vertices, faces), _NO_SHIFT),)
    return Shape(frame, parts, select_outermost(vertices), link.boxes)


def _bound_levers(robot: Robot, first: _Body, second: _Body) -> FloatArray:
    """Upper bounds of the distance by which each joint brings two bodies nearer (J,).

    mm per rad or mm. To rotate one body about a joint is to rotate the other one in the opposite
    direction, so the one that is nearer to the axis counts. The lever is the distance of its
    farthest point from the axis.
    """
    near, far = sorted((first, second), key=lambda body: body.frame)
    between = slice(near.frame, far.frame)
    joints = robot.joints[between]
    levers = np.zeros(len(robot.joints))
    if not joints:
        return levers
    sliding = ~robot.revolute[between]
    travel = (np.abs(robot.coupling) @ np.abs(robot.limits).max(axis=1))[between] * sliding
    shifts, axes, turned = np.empty((3, len(joints), 3))
    for k, joint in enumerate(joints):
        shifts[k], axes[k] = joint.previous_from_joint.origin, joint.axis
        turned[k] = joint.previous_from_joint.rotation @ joint.axis
    outward = _sum_levers(near.measure_reach(shifts[0], turned[0]), turned, shifts[1:], travel)
    inward = _sum_levers(
        far.measure_reach(np.zeros(3), axes[-1]), axes[::-1], shifts[:0:-1], travel[::-1]
    )
    levers[between] = np.where(sliding, 1.0, np.minimum(outward, inward[::-1]))
    return levers


def _sum_levers(
    reach_at_first: tuple[float, float], axes: FloatArray, shifts: FloatArray, travel: FloatArray
) -> FloatArray:
    """The largest distance of a body from each of K axes at any joint values (K,), mm.

    reach_at_first: largest distance from the first axis, and from its origin, mm.
    axes: (K, 3) unit vectors.
    shifts: (K - 1, 3) from the origin of each axis to that of the next one, mm.
    travel: (K,) mm by which a sliding joint moves the links beyond it, 0 for others.
    """
    distances, reach = [reach_at_first[0]], reach_at_first[1] + travel[0]
    for axis, shift, slide in zip(axes[1:], shifts, travel[1:], strict=True):
        distances.append(float(np.linalg.norm(np.cross(shift, axis))) + reach)
        reach += float(np.linalg.norm(shift)) + slide
    return np.array(distances)
