"""What is too much: the limits beyond which an input is a mistake or an attack, and is refused before it costs much.

docs/reliability.md has this table. None is near what a real part needs; who needs more splits the part.
"""

from __future__ import annotations

from typing import NamedTuple


class Limit(NamedTuple):
    """name: how the code and docs/reliability.md call it. bounds: what may not be more (or less) than ``value``."""

    name: str
    value: float
    unit: str
    bounds: str


_TABLE = (
    Limit("file_bytes", 1_000_000_000, "bytes", "any file that is read, and standard input"),
    Limit("number", 1e6, "", "any number of a job but a seed, and of a plan file, on either side of 0"),
    Limit("passes", 1000, "passes", "`operation.passes`"),
    Limit("stepover", 0.01, "diameters, at least", "`operation.stepover`"),
    Limit("chord", 1e-6, "mm, at least", "`tolerance.chord`"),
    Limit("motions", 3_000_000, "motions", "the segments of all paths times the passes"),
    Limit("dxf_depth", 64, "blocks", "block references within another in a DXF drawing"),
    Limit("dxf_entities", 1_000_000, "entities", "what the blocks and arrays of a DXF drawing expand to"),
    Limit("svg_bytes", 200_000_000, "bytes", "an SVG drawing"),
    Limit("svg_depth", 64, "references", "`use` within what another `use` refers to"),
    Limit("svg_uses", 100_000, "elements", "what the `use` elements of an SVG drawing expand to"),
    Limit("svg_elements", 2_000_000, "elements", "all elements of an SVG drawing"),
    Limit("svg_page", 1e6, "mm", "width and height of an SVG page"),
    Limit("picture_pixels", 200_000_000, "pixels", "a photo or a scan"),
    Limit("picture_bytes", 600_000_000, "bytes", "its pixels as decoded: 16-bit RGBA has eight bytes for each"),
    Limit("step_id", 2**31 - 1, "", "the number of an entity in a STEP file"),
    Limit("step_seconds", 300, "s", "what the CAD kernel may take to read a STEP file"),
    Limit("step_place", 1e9, "units of the file", "a coordinate of a point in a STEP file"),
    Limit("model_bytes", 1_000_000_000, "bytes", "what the model of a 3MF file unpacks to; nothing else is unpacked"),
    Limit("accessor", 1, "elements for each byte", "an accessor of a GLB file, by the size of the file"),
    Limit("plugin_seconds", 30, "s", "what a plug-in may take to be imported, and a reader to recognise a file"),
    Limit("urdf_bytes", 8_000_000, "bytes", "a URDF"),
)
LIMITS = {limit.name: limit for limit in _TABLE}


def most(name: str) -> int:
    """The value of the limit ``name`` as a whole number."""
    return int(LIMITS[name].value)


def table() -> str:
    """The limits as Markdown."""
    rows = (f"| `{one.name}` | {one.value:,.10g} | {one.unit} | {one.bounds} |" for one in _TABLE)
    return "\n".join(["| limit | value | unit | of what |", "|---|---|---|---|", *rows]) + "\n"
