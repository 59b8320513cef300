"""Reads links, joints and shapes from a URDF file, in mm and rad, and checks each by itself.

Source: the pages urdf/XML/joint and urdf/XML/link of the ROS wiki. Materials, inertia,
transmissions, dynamics, calibration and safety controllers are not read, since they do not change
the positions that an arm can reach.
"""

from __future__ import annotations

import itertools
import math
import re
import stat
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser, fromstring

from msgspec import Struct

from camgen.model.errors import InputError, make_one_line
from camgen.model.limits import format_limit
from camgen.model.pose import Pose, Vec3, rotation_from_fixed_xyz
from camgen.read.files import Files, reason

# Numbers, poses and names in the elements of a URDF, in mm and rad.

#: Lengths in m and angles in rad beyond this are damage.
_DAMAGED_BEYOND = 1e4
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
#: rad: an angle that differs from a multiple of 90 deg by at most this, and by at most one unit of
#: its last digit, is read as that multiple.
_ROUNDED = 1e-3
#: rad: change of an angle from which on it counts as replaced.
_EXACT = 1e-9
#: Maximum number of letters of a name.
_LONGEST = 500
ZERO: Vec3 = (0.0, 0.0, 0.0)


class UrdfError(Exception):
    """An invalid element. Functions that know the file raise it as InputError."""

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        super().__init__(what, where, remedy)
        self.what, self.where, self.remedy = what, where, remedy


def read_name(element: Element, key: str, where: str = "") -> str:
    """The attribute `key`, which must be stated."""
    value = element.get(key, "").strip()
    if not value:
        raise UrdfError(f"{element.tag} has no {key}", where, f'give it {key}="..."')
    if len(value) > _LONGEST:
        raise UrdfError(
            f"{element.tag} {value[:20]}... has a {key} of {len(value)} letters",
            where,
            "shorten it",
        )
    if not value.isprintable():
        raise UrdfError(f"{element.tag} has a {key} that cannot be printed", where, "rename it")
    return value


def read_number(text: str, where: str) -> float:
    """A finite number, not larger than lengths in m and angles in rad can be."""
    text = text.strip()
    if not _NUMBER.fullmatch(text):
        raise UrdfError(f'"{text[:40]}" is not a number', where)
    value = float(text)
    if not abs(value) < _DAMAGED_BEYOND:
        raise UrdfError(f"{text[:40]} is beyond all measure", where, "lengths are m, angles rad")
    return value


def read_optional(element: Element | None, key: str, where: str, unit: float = 1.0) -> float | None:
    """The number `key` of an element, times `unit`; None if it is not stated."""
    if element is None or key not in element.attrib:
        return None
    return unit * read_number(element.attrib[key], f"{where}, {key}")


def read_three(element: Element | None, key: str, default: Vec3, where: str) -> Vec3:
    """Three numbers `key` of an element, `default` if they are not stated."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise UrdfError(f"three numbers are needed, not {len(words)}", f"{where}, {key}")
    x, y, z = (read_number(word, f"{where}, {key}") for word in words)
    return (x, y, z)


def read_pose(element: Element, where: str) -> Pose:
    """The pose `origin` of an element in the frame of its parent, mm; identity without it."""
    origin = element.find("origin")
    x, y, z = read_three(origin, "xyz", ZERO, where)
    read_three(origin, "rpy", ZERO, where)
    roll, pitch, yaw = map(_read_angle, _list_angles(origin))
    return Pose(rotation_from_fixed_xyz(roll, pitch, yaw), (1000 * x, 1000 * y, 1000 * z))


def _count_rounded_angles(element: Element) -> int:
    """The number of angles of its `origin` that are read as multiples of 90 deg."""
    words = _list_angles(element.find("origin"))
    return sum(abs(_read_angle(word) - float(word)) > _EXACT for word in words)


def _list_angles(origin: Element | None) -> list[str]:
    return ("0 0 0" if origin is None else origin.get("rpy", "0 0 0")).split()


def _read_angle(text: str) -> float:
    """The angle of a text, rad: 1.5708 and 1.57 are 90 deg, 1.58 and 0.001 are not changed.

    With 0.0002 deg between axes that should be square, no arm would have a closed form.
    """
    value = float(text)
    quarters = round(value / (math.pi / 2))
    if not quarters:
        return value
    digits, _, power = text.lower().partition("e")
    last = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    whole = quarters * math.pi / 2
    return whole if abs(value - whole) <= min(last, _ROUNDED) else value


def read_direction(element: Element, where: str) -> Vec3:
    """The `axis` of an element, of length 1; x without it."""
    stated = read_three(element.find("axis"), "xyz", (1.0, 0.0, 0.0), f"{where}, axis")
    length = math.hypot(*stated)
    if length < 1e-6:
        raise UrdfError("the axis has no direction", where, "give axis xyz, of length 1")
    x, y, z = (value / length for value in stated)
    return (x, y, z)


TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_SHAPES = ("box", "cylinder", "sphere", "mesh")


class RawJoint(Struct, frozen=True, eq=False):
    """A joint as described.

    type: an element of `TYPES`.
    parent, child: names of links.
    parent_from_child: pose at value 0.
    axis: direction of length 1.
    lower, upper: limits, rad or mm; None if they are not stated.
    velocity: rad/s or mm/s; None if it is not stated.
    follows: name of the joint that it mimics, or empty.
    """

    name: str
    type: str
    parent: str
    child: str
    parent_from_child: Pose
    axis: Vec3
    lower: float | None
    upper: float | None
    velocity: float | None
    follows: str

    @property
    def sliding(self) -> bool:
        """Whether the joint moves along its axis."""
        return self.type == "prismatic"


class UrdfShape(Struct, frozen=True, eq=False):
    """A solid of a link.

    kind: box, cylinder, sphere or mesh.
    size: edge lengths of the cuboid around it, mm; for a mesh the factors from its numbers to m.
    mesh: name of the file of a mesh.
    """

    kind: str
    link_from_shape: Pose
    size: Vec3
    mesh: str = ""


class Description(Struct, frozen=True, eq=False):
    """The content of a file.

    file: path of the file.
    name: name of the robot.
    links: shapes for collisions of each link, or its visual shapes if it has no others.
    visible: visual shapes of each link.
    joints: joints in the order of the file.
    rounded: number of angles that are read as multiples of 90 deg.
    """

    file: str
    name: str
    links: dict[str, tuple[UrdfShape, ...]]
    visible: dict[str, tuple[UrdfShape, ...]]
    joints: tuple[RawJoint, ...]
    rounded: int


def read_description(path: Path, files: Files) -> Description:
    """The links and joints of a file. Raises InputError with the element that is wrong."""
    root = _parse(str(path), _read_content(path, files))
    try:
        return _describe(path, root)
    except UrdfError as wrong:
        raise InputError(str(path), wrong.what, wrong.where, wrong.remedy) from None


def _describe(path: Path, root: Element) -> Description:
    links: dict[str, tuple[UrdfShape, ...]] = {}
    visible: dict[str, tuple[UrdfShape, ...]] = {}
    for element in root.findall("link"):
        name = read_name(element, "name")
        if name in links:
            raise UrdfError(f"there are two links {name}", remedy="rename one")
        visible[name] = tuple(
            _read_shape(body, f"link {name}") for body in element.findall("visual")
        )
        bodies = element.findall("collision")
        links[name] = tuple(_read_shape(body, f"link {name}") for body in bodies) or visible[name]
    joints: dict[str, RawJoint] = {}
    for element in root.findall("joint"):
        joint = _read_joint(element)
        if joint.name in joints:
            raise UrdfError(f"there are two joints {joint.name}", remedy="rename one")
        for end in (joint.parent, joint.child):
            if end not in links:
                raise UrdfError(f"there is no link {end}", f"joint {joint.name}")
        joints[joint.name] = joint
    rounded = sum(_count_rounded_angles(element) for element in root.findall("joint"))
    name = make_one_line(root.get("name", "").strip()[:60]) or path.stem
    return Description(str(path), name, links, visible, tuple(joints.values()), rounded)


def _read_joint(element: Element) -> RawJoint:
    name = read_name(element, "name")
    where = f"joint {name}"
    kind = read_name(element, "type", where)
    if kind not in TYPES:
        raise UrdfError(
            f'"{kind[:40]}" is not a type of joint', where, f"known are {', '.join(TYPES)}"
        )
    limit, mimic = element.find("limit"), element.find("mimic")
    unit = 1000.0 if kind == "prismatic" else 1.0
    return RawJoint(
        name=name,
        type=kind,
        parent=_read_end(element, "parent", where),
        child=_read_end(element, "child", where),
        parent_from_child=read_pose(element, where),
        axis=(1.0, 0.0, 0.0) if kind == "fixed" else read_direction(element, where),
        lower=read_optional(limit, "lower", f"{where}, limit", unit),
        upper=read_optional(limit, "upper", f"{where}, limit", unit),
        velocity=read_optional(limit, "velocity", f"{where}, limit", unit),
        follows="" if mimic is None else read_name(mimic, "joint", where),
    )


def _read_end(element: Element, tag: str, where: str) -> str:
    end = element.find(tag)
    if end is None:
        raise UrdfError(f"it has no {tag}", where, f'give it <{tag} link="..."/>')
    return read_name(end, "link", where)


def _read_shape(element: Element, where: str) -> UrdfShape:
    geometry = element.find("geometry")
    kinds = [] if geometry is None else [child for child in geometry if child.tag in _SHAPES]
    if len(kinds) != 1:
        raise UrdfError(f"{element.tag} needs one shape, {', '.join(_SHAPES)}", where)
    shape = kinds[0]
    link_from_shape = read_pose(element, f"{where}, {element.tag}")
    if shape.tag == "mesh":
        scale = read_three(shape, "scale", (1.0, 1.0, 1.0), f"{where}, mesh")
        return UrdfShape("mesh", link_from_shape, scale, read_name(shape, "filename", where))
    if shape.tag == "box":
        x, y, z = read_three(shape, "size", ZERO, f"{where}, box")
    else:
        x = y = 2 * (read_optional(shape, "radius", f"{where}, {shape.tag}") or 0.0)
        z = (
            x
            if shape.tag == "sphere"
            else read_optional(shape, "length", f"{where}, {shape.tag}") or 0.0
        )
    if min(x, y, z) <= 0:
        raise UrdfError(f"a {shape.tag} has no size", where, "give lengths above 0, m")
    return UrdfShape(shape.tag, link_from_shape, (1000 * x, 1000 * y, 1000 * z))


class DeclaredError(Exception):
    """The file has a DOCTYPE."""


class UndeclaredBuilder(TreeBuilder):
    """Stops at a DOCTYPE, in which entities are declared.

    So no entity is ever expanded, and no other file is opened.
    """

    def doctype(self, _name: str, _public: str | None, _system: str | None) -> NoReturn:
        """Called at a DOCTYPE."""
        raise DeclaredError


def _read_content(path: Path, files: Files) -> bytes:
    file = str(path)
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode):
            raise InputError(file, "is not a file", "cell.robot", "name the URDF file of the arm")
        limit = files.limits.urdf_bytes
        if state.st_size > limit:
            raise InputError(
                file,
                f"has more than {format_limit(limit)} bytes: no description of a robot",
                remedy="name the URDF of the arm, or raise limits.urdf_bytes",
            )
        return files.open(path).data
    except FileNotFoundError as error:
        raise InputError(
            file, "no such file", "cell.robot", "a job file names it from its own folder"
        ) from error
    except (OSError, ValueError) as error:  # ValueError for a zero byte in the name
        raise InputError(file, f"cannot be read: {reason(error)}") from error


def _parse(file: str, data: bytes) -> Element:
    xacro = InputError(
        file, "is xacro, from which a URDF is made", remedy="expand it: xacro arm.xacro > arm.urdf"
    )
    if file.lower().endswith(".xacro"):
        raise xacro
    try:
        root: Element = fromstring(data, XMLParser(target=UndeclaredBuilder()))
    except DeclaredError:
        raise InputError(
            file, "declares a DOCTYPE, which a URDF does not need", remedy="remove it"
        ) from None
    except ParseError as error:
        what, _, where = str(error).partition(": ")
        raise InputError(file, f"is not XML: {what}", where) from error
    except (LookupError, ValueError) as error:
        # An encoding that Python does not have, or that is not one of text.
        raise InputError(file, f"is not XML: {error}", remedy="save it as UTF-8") from error
    if any("xacro}" in str(element.tag) for element in root.iter()):
        raise xacro
    if root.tag != "robot":
        raise InputError(file, f"describes no robot: its root is {str(root.tag)[:40]}")
    return root


# The files of an arm: the URDF and its meshes.

#: Number of folders above the URDF in which a mesh is searched.
_FAR_UP = 6


def list_urdf_files(file: str, files: Files) -> tuple[Path, ...]:
    """The URDF, and the meshes that it names and that exist.

    Raises InputError if the URDF cannot be read.
    """
    described = read_description(Path(file), files)
    tables = *described.links.values(), *described.visible.values()
    names = dict.fromkeys(shape.mesh for shape in itertools.chain(*tables) if shape.mesh)
    meshes = [find_mesh(name, Path(file).parent) for name in names]
    return (Path(file), *filter(None, meshes))


def find_mesh(name: str, folder: Path) -> Path | None:
    """The file of a mesh, None if it does not exist.

    A path is relative to the folder of the URDF. In `package://arm/meshes/base.stl` the package can
    be anywhere. The longest end of the name that exists is chosen: next to the URDF, or, together
    with its folder, above it.

    folder: folder of the URDF.
    """
    scheme, mark, rest = name.partition("://")
    path = rest if mark else name
    if not mark or scheme == "file":
        file = _find_file(folder / path)
        if file or mark:
            return file
    parts = [part for part in Path(path).parts if part not in ("..", "/")]
    homes = [folder, *folder.resolve().parents][: _FAR_UP + 1]
    for count in range(len(parts), 0, -1):
        for home in homes if count > 1 else homes[:1]:
            if file := _find_file(home.joinpath(*parts[-count:])):
                return file
    return None


def _find_file(path: Path) -> Path | None:
    try:
        return path if path.is_file() else None
    except (OSError, ValueError):  # An invalid name of a file.
        return None
