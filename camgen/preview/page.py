"""The page: one file that needs no other and no network. What it shows goes in as data, never as markup or script."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib import resources

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.report import clean
from camgen.geometry.ragged import run_starts
from camgen.model.errors import one_line
from camgen.model.part import Solid
from camgen.model.pose import FloatArray, Pose
from camgen.preview.meshes import one_mesh
from camgen.preview.stock import Mark
from camgen.preview.view import View
from camgen.robots.models import Link

#: Those that run before the browser reads the data: it prepares what draws meanwhile.
_FIRST = ("space.js", "gl.js", "lines.js", "detail.js", "bodies.js")
#: The scripts in the order in which they run, in one scope.
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
#: Before the last one, only in pages that need them: what plays the cut, what lays a picture under the paths, and what
#: changes the order and the seams of paths.
_CUT, _PHOTO, _EDIT = "stock.js", "photo.js", "edit.js"


class Edits(Struct, frozen=True):
    """What the workbench lets the user change, by path. seams: x, y, z (mm) where a closed path begins, None for
    others. pinned: whether the job says so. ordered: whether it says when the path runs.
    """

    seams: tuple[tuple[float, float, float] | None, ...]
    pinned: tuple[bool, ...]
    ordered: tuple[bool, ...]


def page(view: View, edits: Edits | None = None) -> str:
    """The preview as HTML text. Same view, same text. edits: only in the workbench."""
    style = _asset("viewer.css")
    first = '"use strict";\n' + "\n".join(map(_asset, _FIRST))
    needed = {_CUT: _has_cut(view), _PHOTO: view.photo is not None, _EDIT: edits is not None}
    names = [
        *_SCRIPTS[:-1],
        *(name for name, is_needed in needed.items() if is_needed),
        _SCRIPTS[-1],
    ]
    script = '(() => {\n"use strict";\n' + "\n".join(map(_asset, names)) + "})();\n"
    filled = {
        "title": escape(one_line(view.title)),
        "policy": "default-src 'none'; img-src data: blob:; "
        f"script-src {_hash(first)} {_hash(script)}; style-src {_hash(style)}",
        "style": style,
        "first": first,
        "data": _data(view, edits),
        "script": script,
    }
    pieces = _asset("index.html").split("@@")
    return "".join(filled[piece] if k % 2 else piece for k, piece in enumerate(pieces))


@cache
def _asset(name: str) -> str:
    return (resources.files("camgen.preview") / "web" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """What a content security policy calls this very text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _data(view: View, edits: Edits | None) -> str:
    """The view as JSON that can stand inside a script element: nothing in it can end the element."""
    text = msgspec.json.encode(_plain(view, edits)).decode()
    for mark in "<>&\u2028\u2029":
        text = text.replace(mark, f"\\u{ord(mark):04x}")
    return text


def _plain(view: View, edits: Edits | None) -> dict[str, object]:
    """The view as plain data. Points are told from ``origin``, so that 32 bits are enough for them."""
    way, chains = view.track, view.chains
    shown = [way.position, chains.points, *([view.solid.vertices] if view.solid else [])]
    every = np.concatenate(shown)
    origin = np.round((every.min(axis=0) + every.max(axis=0)) / 2) if len(every) else np.zeros(3)
    motions = way.events
    return {
        "title": one_line(view.title),
        "facts": view.facts,
        "origin": origin.tolist(),
        "lines": {
            "points": _pack(chains.points - origin),
            "counts": chains.counts.tolist(),
            "rows": view.lines,
        },
        "flat": view.flat,
        "solid": view.solid and _mesh(view.solid, origin),
        "paths": view.rows,
        **_cut(view, origin),
        **_photo(view, origin),
        **_edits(edits, origin),
        "numbers": _numbers(view, origin),
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
            "why": one_line(view.listing.why),
        },
        "track": {
            "position": _pack(way.position - origin),
            "axis": _pack_runs(way.axis),
            "time": _pack(way.time),
            "event": _pack_runs(way.event, np.uint32, steps=True),
            "instruction": _pack_runs(motions.instruction, np.uint32, steps=True),
            "kind": _pack_runs(motions.kind, np.uint8),
            "path": _pack_runs(motions.path, np.int32),
            "feed": _pack_runs(motions.feed),
            "force": _pack_runs(motions.force),
        },
        **_executed(view, origin),
        "switches": [[one.time, clean(one.signal), one.value] for one in view.switches],
        "tool": {
            "diameter": view.diameter,
            "flange_from_tool": _pose(view.flange_from_tool),
            "bodies": _links(view.bodies),
        },
        "standing": _links(view.standing),
        "meshes": [[name, _mesh(shape, origin)] for name, shape in view.meshes],
        "arm": _arm(view),
    }


def _executed(view: View, origin: FloatArray) -> dict[str, object]:
    if view.executed is None:
        return {}
    points, counts = view.executed.points - origin, view.executed.counts.tolist()
    return {"executed": {"points": _pack(points), "counts": counts}}


def _photo(view: View, origin: FloatArray) -> dict[str, object]:
    if view.photo is None:
        return {}
    corners = np.column_stack([view.photo.corners, np.zeros(4)]) - origin
    return {"photo": {"address": view.photo.address, "corners": corners.tolist()}}


def _edits(edits: Edits | None, origin: FloatArray) -> dict[str, object]:
    if edits is None:
        return {}
    seams = [place and (np.array(place) - origin).tolist() for place in edits.seams]
    return {"edits": {"seams": seams, "pinned": edits.pinned, "ordered": edits.ordered}}


def _has_cut(view: View) -> bool:
    return _has_tools(view) or bool(view.marks)


def _has_tools(view: View) -> bool:
    return view.stock is not None or len(view.tools) > 1


def _cut(view: View, origin: FloatArray) -> dict[str, object]:
    """The stock, the tools with the one of each event, and the marks; nothing for one tool without a stock."""
    found: dict[str, object] = {}
    if _has_tools(view):
        found["tools"] = [
            {
                "diameter": tool.diameter,
                "profile": tool.profile,
                "flange_from_tool": _pose(tool.frame),
            }
            for tool in view.tools
        ]
        found["tool_of"] = _pack_runs(view.tool_of, np.uint8)
    if view.stock:
        found["stock"] = {
            "low": (view.stock.low - origin).tolist(),
            "high": (view.stock.high - origin).tolist(),
        }
    if view.marks:
        found["marks"] = [
            {
                "kind": mark.kind,
                "number": mark.number,
                "text": one_line(mark.text),
                **_fill(mark, origin),
            }
            for mark in view.marks
        ]
    return found


def _fill(mark: Mark, origin: FloatArray) -> dict[str, str]:
    """The outline of a mark and the triangles in it, as points."""
    from shapely import Polygon, constrained_delaunay_triangles, get_coordinates, get_parts  # noqa: PLC0415 (slow)

    around = np.vstack([mark.polygon, mark.polygon[:1]])
    corners = get_parts(constrained_delaunay_triangles(Polygon(mark.polygon, mark.holes).buffer(0)))
    inside = get_coordinates(corners).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    lifted = (
        np.column_stack([flat, np.full(len(flat), mark.z)]) - origin for flat in (around, inside)
    )
    return dict(zip(("outline", "triangles"), map(_pack, lifted), strict=True))


def _numbers(view: View, origin: FloatArray) -> list[object]:
    """Of the edges of a 3-D part: number or id, where it stands, the path that runs it, -1 for none."""
    if view.solid is None:
        return []
    from camgen.preview.figure import figure_edges, oblique  # noqa: PLC0415 (loads OpenCV, only for 3-D parts)

    edges = figure_edges(view, view.solid, oblique(), None)
    return [
        [edge.text, *(edge.middle - origin).tolist(), edge.number] for edge in edges if edge.text
    ]


def _arm(view: View) -> dict[str, object] | None:
    if view.arm is None:
        return None
    robot = view.arm.robot
    return {
        "name": robot.name,
        "work_from_base": _pose(view.base_from_work.inverse()),
        "flange": _pose(robot.flange),
        "coupling": robot.coupling.tolist(),
        "joints": [[j.name, j.sliding, _pose(j.previous_from_joint), j.axis] for j in robot.joints],
        "links": [
            [*told, _surface(link)]
            for told, link in zip(_links(robot.links), robot.links, strict=True)
        ],
        "values": _pack(view.arm.joints),
        "time": _pack(view.arm.time),
    }


def _surface(link: Link) -> dict[str, str] | None:
    found = one_mesh(link.surfaces)
    return found and {"vertices": _pack(found[0]), "faces": _pack(found[1], np.uint32)}


def _links(links: Sequence[Link]) -> list[list[object]]:
    """Name, then pose and half edges of each box."""
    return [
        [link.name, [[_pose(box.link_from_box), box.half] for box in link.boxes]] for link in links
    ]


def _mesh(solid: Solid, origin: FloatArray) -> dict[str, str]:
    return {"vertices": _pack(solid.vertices - origin), "faces": _pack(solid.faces, np.uint32)}


def _pose(pose: Pose) -> list[float]:
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
    """Rows that come many times after each other once, with how often; as ``_pack`` where that is no shorter.

    steps: whole numbers by their steps from one to the next, the first from 0.
    """
    rows = values.astype(kind).reshape(len(values), -1)
    told = np.diff(rows.astype(np.int64), axis=0, prepend=0) if steps else rows
    begun = run_starts(told)
    if 2 * len(begun) > len(told):
        return _pack(rows, kind)
    counts = np.diff(np.append(begun, len(told)))
    own = _pack(told[begun], np.int32) if steps else _pack(told[begun], kind)
    return {"counts": _pack(counts, np.uint32), "values": own, "steps": steps}
