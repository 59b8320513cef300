"""Writes a view as one HTML file that needs no other file and no network.

The content of the view is embedded as data, never as markup or script.
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from html import escape
from importlib import resources
from itertools import compress

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.report import clean
from camgen.geometry.ragged import find_run_starts
from camgen.model.errors import make_one_line
from camgen.model.part import Solid
from camgen.model.pose import FloatArray, Pose
from camgen.model.sequences import take_rows
from camgen.preview.curves import lift
from camgen.preview.meshes import merge_surfaces
from camgen.preview.stock import Mark
from camgen.preview.view import View
from camgen.robots.models import Link

#: Scripts that run before the browser reads the data. They set up the drawing meanwhile.
_FIRST = ("space.js", "gl.js", "lines.js", "detail.js", "bodies.js")
#: All other scripts in the order in which they run, in one scope.
_SCRIPTS = (
    "data.js",
    "theme.js",
    "tabs.js",
    "scene.js",
    "shapes.js",
    "arm.js",
    "camera.js",
    "list.js",
    "pick.js",
    "notes.js",
    "numbers.js",
    "listing.js",
    "player.js",
    "host.js",
    "viewer.js",
)
#: Scripts before the last one, only for pages that need them: material removal, the picture under
#: the paths, and the changes of order and seams.
_CUT, _PHOTO, _EDIT = "stock.js", "photo.js", "edit.js"


class Edits(Struct, frozen=True):
    """The properties of paths that the user may change in the workbench, one value per path.

    seams: x, y, z (mm) of the start of a closed path; None for an open one.
    pinned: whether the job sets the seam.
    ordered: whether the job sets the position of the path in the order.
    """

    seams: tuple[tuple[float, float, float] | None, ...]
    pinned: tuple[bool, ...]
    ordered: tuple[bool, ...]


def format_page(view: View, edits: Edits | None = None) -> str:
    """The view as HTML text. Equal views give equal texts.

    edits: changes that the user of the workbench may make; None for any other page.
    """
    style = _read_asset("viewer.css")
    first = '"use strict";\n' + "\n".join(map(_read_asset, _FIRST))
    needed = (_has_tools(view) or view.marks, view.photo is not None, edits is not None)
    names = [*_SCRIPTS[:-1], *compress((_CUT, _PHOTO, _EDIT), needed), _SCRIPTS[-1]]
    script = '(() => {\n"use strict";\n' + "\n".join(map(_read_asset, names)) + "})();\n"
    values = {
        "title": escape(make_one_line(view.title)),
        "policy": "default-src 'none'; img-src data: blob:; "
        f"script-src {_hash(first)} {_hash(script)}; style-src {_hash(style)}",
        "style": style,
        "first": first,
        "data": _encode_view(view, edits),
        "script": script,
    }
    pieces = _read_asset("index.html").split("@@")
    pieces[1::2] = take_rows(values, pieces[1::2])
    return "".join(pieces)


@cache
def _read_asset(name: str) -> str:
    return (resources.files("camgen.preview") / "web" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """The hash of a text as a source of a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _encode_view(view: View, edits: Edits | None) -> str:
    """The view as JSON for a script element, without characters that could end the element."""
    text = msgspec.json.encode(_list_view(view, edits)).decode()
    for mark in "<>&\u2028\u2029":
        text = text.replace(mark, f"\\u{ord(mark):04x}")
    return text


def _list_view(view: View, edits: Edits | None) -> dict[str, object]:
    """The view as plain data. Points are relative to their middle, so that 32 bits are enough."""
    track, chains = view.track, view.chains
    points = np.concatenate([track.position, chains.points])
    if view.solid:
        points = np.concatenate([points, view.solid.vertices])
    origin = np.zeros(3)
    if len(points):
        origin = np.round((points.min(axis=0) + points.max(axis=0)) / 2)
    events = track.events
    content: dict[str, object] = {
        "title": make_one_line(view.title),
        "facts": view.facts,
        "origin": origin.tolist(),
        "lines": {
            "points": _pack(chains.points - origin),
            "counts": chains.counts.tolist(),
            "rows": view.lines,
        },
        "flat": view.flat,
        "solid": view.solid and _pack_mesh(view.solid, origin),
        "paths": view.rows,
        **_list_cut(view, origin),
    }
    if view.photo is not None:
        corners = lift(view.photo.corners) - origin
        content["photo"] = {"address": view.photo.address, "corners": corners.tolist()}
    if edits is not None:
        seams = [place and (np.array(place) - origin).tolist() for place in edits.seams]
        content["edits"] = {"seams": seams, "pinned": edits.pinned, "ordered": edits.ordered}
    content |= {
        "numbers": _list_numbers(view, origin),
        "notes": [
            [
                note.kind,
                note.what,
                note.why,
                note.strict,
                note.lines,
                note.paths,
                (np.array(note.places).reshape(-1, 3) - origin).tolist(),
                note.text,
            ]
            for note in view.notes
        ],
        "listing": {
            "files": view.listing.files,
            "lines": _pack_runs(view.listing.lines, np.uint32, steps=True),
            "why": make_one_line(view.listing.why),
        },
        "track": {
            "position": _pack(track.position - origin),
            "axis": _pack_runs(track.axis),
            "time": _pack(track.time),
            "event": _pack_runs(track.event, np.uint32, steps=True),
            "instruction": _pack_runs(events.instruction, np.uint32, steps=True),
            "kind": _pack_runs(events.kind, np.uint8),
            "path": _pack_runs(events.path, np.int32),
            "feed": _pack_runs(events.feed),
            "force": _pack_runs(events.force),
        },
    }
    if view.executed is not None:
        content["executed"] = {
            "points": _pack(view.executed.points - origin),
            "counts": view.executed.counts.tolist(),
        }
    return content | {
        "switches": [[switch.time, clean(switch.signal), switch.value] for switch in view.switches],
        "tool": {
            "diameter": view.diameter,
            "flange_from_tool": _list_pose(view.flange_from_tool),
            "bodies": list(map(_list_link, view.bodies)),
        },
        "standing": list(map(_list_link, view.standing)),
        "meshes": [[name, _pack_mesh(shape, origin)] for name, shape in view.meshes],
        "arm": _list_arm(view),
    }


def _has_tools(view: View) -> bool:
    return view.stock is not None or len(view.tools) > 1


def _list_cut(view: View, origin: FloatArray) -> dict[str, object]:
    """The stock, the tools with that of each event, and the marks.

    Tools are left out for a program with one tool and without a stock.
    """
    tables: dict[str, object] = {}
    if _has_tools(view):
        tables["tools"] = [
            {
                "diameter": tool.diameter,
                "profile": tool.profile,
                "flange_from_tool": _list_pose(tool.frame),
            }
            for tool in view.tools
        ]
        tables["tool_of"] = _pack_runs(view.tool_of, np.uint8)
    if view.stock:
        tables["stock"] = {
            "low": (view.stock.low - origin).tolist(),
            "high": (view.stock.high - origin).tolist(),
        }
    if view.marks:
        tables["marks"] = [
            {
                "kind": mark.kind,
                "number": mark.width,
                "text": make_one_line(mark.text),
                **_pack_mark(mark, origin),
            }
            for mark in view.marks
        ]
    return tables


def _pack_mark(mark: Mark, origin: FloatArray) -> dict[str, str]:
    """The outline of a mark, and the corners of the triangles inside it."""
    import shapely  # noqa: PLC0415 (slow, only for marks)

    polygon = shapely.Polygon(mark.polygon, mark.holes).buffer(0)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    outline = np.vstack([mark.polygon, mark.polygon[:1]])
    # A triangle has its first corner again as its fourth one.
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    return {
        "outline": _pack(lift(outline, mark.z) - origin),
        "triangles": _pack(lift(corners, mark.z) - origin),
    }


def _list_numbers(view: View, origin: FloatArray) -> list[object]:
    """The labelled edges of a 3-D part.

    Each has its number or id, the place of the label, and the index of its path, -1 for none.
    """
    if view.solid is None:
        return []
    from camgen.preview.figure import list_figure_edges, make_oblique  # noqa: PLC0415 (OpenCV)

    edges = list_figure_edges(view, view.solid, make_oblique(), None)
    return [
        [edge.text, *(edge.middle - origin).tolist(), edge.number] for edge in edges if edge.text
    ]


def _list_arm(view: View) -> dict[str, object] | None:
    if view.arm is None:
        return None
    robot = view.arm.robot
    return {
        "name": robot.name,
        "work_from_base": _list_pose(view.base_from_work.inverse()),
        "flange": _list_pose(robot.flange),
        "coupling": robot.coupling.tolist(),
        "joints": [
            [j.name, j.sliding, _list_pose(j.previous_from_joint), j.axis] for j in robot.joints
        ],
        "links": [[*_list_link(link), _pack_surfaces(link)] for link in robot.links],
        "values": _pack(view.arm.joints),
        "time": _pack(view.arm.time),
    }


def _pack_surfaces(link: Link) -> dict[str, str] | None:
    mesh = merge_surfaces(link.surfaces)
    return mesh and {"vertices": _pack(mesh[0]), "faces": _pack(mesh[1], np.uint32)}


def _list_link(link: Link) -> list[object]:
    """The name of a link, then pose and half edges of each of its boxes."""
    return [link.name, [[_list_pose(box.link_from_box), box.half] for box in link.boxes]]


def _pack_mesh(solid: Solid, origin: FloatArray) -> dict[str, str]:
    return {"vertices": _pack(solid.vertices - origin), "faces": _pack(solid.faces, np.uint32)}


def _list_pose(pose: Pose) -> list[float]:
    """Twelve numbers: the rotation by rows, then the origin."""
    return [*pose.rotation.ravel().tolist(), *pose.origin]


def _pack(values: NDArray[np.generic], kind: type[np.generic] = np.float32) -> str:
    """Little-endian numbers as base64."""
    return base64.b64encode(
        np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<")).tobytes()
    ).decode()


def _pack_runs(
    values: NDArray[np.generic], kind: type[np.generic] = np.float32, steps: bool = False
) -> str | dict[str, object]:
    """Run-length encoding: each row once, with the number of its repetitions.

    steps: encode the differences of whole numbers, the first from 0.

    Returns the result of `_pack` if that is not longer.
    """
    rows = values.astype(kind).reshape(len(values), -1)
    encoded = np.diff(rows.astype(np.int64), axis=0, prepend=0) if steps else rows
    starts = find_run_starts(encoded)
    if 2 * len(starts) > len(encoded):
        return _pack(rows, kind)
    counts = np.diff(np.append(starts, len(encoded)))
    packed = _pack(encoded[starts], np.int32 if steps else kind)
    return {"counts": _pack(counts, np.uint32), "values": packed, "steps": steps}
