"""What a URDF file says: links, joints and shapes, in mm and rad, each checked by itself.

Source: the ROS wiki's pages urdf/XML/joint and urdf/XML/link. Materials, inertia, transmissions, dynamics, calibration
and safety controllers do not say where an arm can go, and are not looked at.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser, fromstring

from msgspec import Struct

from camgen.errors import InputError, one_line
from camgen.pose import Pose, Vec3
from camgen.robots.urdf_values import ZERO, Wrong, direction, name_of, optional, place, rounded_angles, three

#: Bytes: beyond this it is no description of a robot.
_LARGEST = 8_000_000
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_SHAPES = ("box", "cylinder", "sphere", "mesh")


class Limit(Struct, frozen=True):
    """As stated: lower and upper in rad or mm, velocity in rad/s or mm/s; None: not stated."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None


class RawJoint(Struct, frozen=True, eq=False):
    """A joint as described. parent_from_child: at 0. axis: of length 1. follows: the joint that it mimics, or ""."""

    name: str
    type: str
    parent: str
    child: str
    parent_from_child: Pose
    axis: Vec3
    limit: Limit
    follows: str

    @property
    def sliding(self) -> bool:
        """Whether it moves along its axis."""
        return self.type == "prismatic"


class Shape(Struct, frozen=True, eq=False):
    """A solid of a link. kind: box, cylinder, sphere or mesh. size: edge lengths of the cuboid around it, mm; of a mesh
    the scale that takes its numbers to m. mesh: the name of its file.
    """

    kind: str
    link_from_shape: Pose
    size: Vec3
    mesh: str = ""


class Description(Struct, frozen=True, eq=False):
    """A whole file. links: their shapes by name, those for collisions, or those to be seen where there are no others.
    rounded: how many angles were taken as the multiples of 90 deg that they are rounded from.
    """

    file: str
    name: str
    links: dict[str, tuple[Shape, ...]]
    joints: tuple[RawJoint, ...]
    rounded: int


def read_description(path: Path) -> Description:
    """The links and joints in the file ``path``. InputError with the element that is wrong."""
    root = _parsed(str(path), _content(path))
    try:
        return _described(path, root)
    except Wrong as wrong:
        raise InputError(str(path), wrong.what, wrong.where, wrong.remedy) from None


def _described(path: Path, root: Element) -> Description:
    links: dict[str, tuple[Shape, ...]] = {}
    for element in root.findall("link"):
        name = name_of(element, "name")
        if name in links:
            raise Wrong(f"there are two links {name}", remedy="rename one")
        bodies = element.findall("collision") or element.findall("visual")
        links[name] = tuple(_shape(body, f"link {name}") for body in bodies)
    joints: dict[str, RawJoint] = {}
    for element in root.findall("joint"):
        joint = _joint(element)
        if joint.name in joints:
            raise Wrong(f"there are two joints {joint.name}", remedy="rename one")
        for end in (joint.parent, joint.child):
            if end not in links:
                raise Wrong(f"there is no link {end}", f"joint {joint.name}")
        joints[joint.name] = joint
    rounded = sum(rounded_angles(element) for element in root.findall("joint"))
    name = one_line(root.get("name", "").strip()[:60]) or path.stem
    return Description(str(path), name, links, tuple(joints.values()), rounded)


def _joint(element: Element) -> RawJoint:
    name = name_of(element, "name")
    where = f"joint {name}"
    kind = name_of(element, "type", where)
    if kind not in TYPES:
        raise Wrong(f'"{kind[:40]}" is not a type of joint', where, f"known are {', '.join(TYPES)}")
    mimic = element.find("mimic")
    return RawJoint(
        name=name,
        type=kind,
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        parent_from_child=place(element, where),
        axis=(1.0, 0.0, 0.0) if kind == "fixed" else direction(element, where),
        limit=_limit(element, 1000.0 if kind == "prismatic" else 1.0, where),
        follows="" if mimic is None else name_of(mimic, "joint", where),
    )


def _end(element: Element, tag: str, where: str) -> str:
    end = element.find(tag)
    if end is None:
        raise Wrong(f"it has no {tag}", where, f'give it <{tag} link="..."/>')
    return name_of(end, "link", where)


def _limit(element: Element, unit: float, where: str) -> Limit:
    found = element.find("limit")
    if found is None:
        return Limit()
    values = [optional(found, key, f"{where}, limit") for key in ("lower", "upper", "velocity")]
    return Limit(*(None if value is None else value * unit for value in values))


def _shape(element: Element, where: str) -> Shape:
    geometry = element.find("geometry")
    kinds = [] if geometry is None else [child for child in geometry if child.tag in _SHAPES]
    if len(kinds) != 1:
        raise Wrong(f"{element.tag} needs one shape, {', '.join(_SHAPES)}", where)
    own = kinds[0]
    link_from_shape = place(element, f"{where}, {element.tag}")
    if own.tag == "mesh":
        scale = three(own, "scale", (1.0, 1.0, 1.0), f"{where}, mesh")
        return Shape("mesh", link_from_shape, scale, name_of(own, "filename", where))
    if own.tag == "box":
        x, y, z = three(own, "size", ZERO, f"{where}, box")
    else:
        x = y = 2 * (optional(own, "radius", f"{where}, {own.tag}") or 0.0)
        z = x if own.tag == "sphere" else optional(own, "length", f"{where}, {own.tag}") or 0.0
    if min(x, y, z) <= 0:
        raise Wrong(f"a {own.tag} has no size", where, "give lengths above 0, m")
    return Shape(own.tag, link_from_shape, (1000 * x, 1000 * y, 1000 * z))


class _DeclaredError(Exception):
    """The file has a DOCTYPE."""


class _Builder(TreeBuilder):
    """Ends at a DOCTYPE, the place where entities are declared: none is ever expanded, and no other file opened."""

    def doctype(self, _name: str, _public: str | None, _system: str | None) -> NoReturn:
        raise _DeclaredError


def _content(path: Path) -> bytes:
    file = str(path)
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode):
            raise InputError(file, "is not a file", "cell.robot", "name the URDF file of the arm")
        if state.st_size > _LARGEST:
            raise InputError(file, f"is larger than {_LARGEST // 1_000_000} MB: no description of a robot")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(file, "no such file", "cell.robot", "a job file names it from its own folder") from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(file, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _parsed(file: str, data: bytes) -> Element:
    xacro = InputError(file, "is xacro, from which a URDF is made", remedy="expand it: xacro arm.xacro > arm.urdf")
    if file.lower().endswith(".xacro"):
        raise xacro
    try:
        root: Element = fromstring(data, XMLParser(target=_Builder()))
    except _DeclaredError:
        raise InputError(file, "declares a DOCTYPE, which a URDF does not need", remedy="remove it") from None
    except ParseError as error:
        what, _, where = str(error).partition(": ")
        raise InputError(file, f"is not XML: {what}", where) from error
    except (LookupError, ValueError) as error:  # an encoding that Python does not have, or that is none of text
        raise InputError(file, f"is not XML: {error}", remedy="save it as UTF-8") from error
    if any("xacro}" in str(element.tag) for element in root.iter()):
        raise xacro
    if root.tag != "robot":
        raise InputError(file, f"describes no robot: its root is {str(root.tag)[:40]}")
    return root
