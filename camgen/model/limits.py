"""Limits of inputs. An input beyond them is a mistake or an attack, and is refused at little cost.

Each limit is a setting of the job in `[limits]`; docs/reliability.md has them as a table. No real
part comes near to one.
"""

from typing import Annotated

from msgspec import Meta, Struct


def _describe(about: str, top: float | None = None) -> Meta:
    """The description of a limit.

    top: value that no user may exceed; None for no bound.
    """
    return Meta(gt=0, le=top, description=about)


class Limits(Struct, frozen=True, forbid_unknown_fields=True):
    """[limits]: largest inputs; a larger one is refused until its limit is raised."""

    file_bytes: Annotated[float, _describe("bytes of any file, and of standard input")] = (
        1_000_000_000
    )
    number: Annotated[
        float, _describe("any number of a job but a seed and limits, on either side of 0", 1e9)
    ] = 1_000_000
    passes: Annotated[float, _describe("`operation.passes`", 1e6)] = 1000
    stepover: Annotated[float, _describe("`operation.stepover` at least, diameters")] = 0.01
    chord: Annotated[float, _describe("`tolerance.chord` at least, mm")] = 1e-6
    motions: Annotated[float, _describe("the segments of all paths times the passes")] = 3_000_000
    edges: Annotated[float, _describe("selected edges of a 3-D part")] = 2000
    stations: Annotated[
        float, _describe("places at which pieces of edges are sought; the others are not sought")
    ] = 50_000
    dxf_depth: Annotated[
        float, _describe("block references within another in a DXF drawing", 200)
    ] = 64
    dxf_entities: Annotated[
        float, _describe("entities that the blocks and arrays of a DXF drawing expand to")
    ] = 1_000_000
    points: Annotated[float, _describe("points of a list of points")] = 1_000_000
    svg_bytes: Annotated[float, _describe("bytes of an SVG drawing")] = 200_000_000
    svg_depth: Annotated[
        float, _describe("`use` within what another `use` refers to, in an SVG drawing")
    ] = 64
    svg_uses: Annotated[
        float, _describe("elements that the `use` elements of an SVG drawing expand to")
    ] = 100_000
    svg_elements: Annotated[float, _describe("all elements of an SVG drawing")] = 2_000_000
    svg_page: Annotated[float, _describe("width and height of an SVG page, mm", 1e9)] = 1_000_000
    picture_pixels: Annotated[float, _describe("pixels of a photo or a scan")] = 200_000_000
    picture_bytes: Annotated[
        float, _describe("bytes of its pixels as decoded: 16-bit RGBA has eight for each")
    ] = 600_000_000
    camera_bytes: Annotated[float, _describe("bytes of a camera file")] = 1_000_000
    mesh_place: Annotated[float, _describe("a coordinate in a mesh, units of the file", 1e12)] = 1e9
    step_seconds: Annotated[
        float, _describe("what the CAD kernel may take to read a STEP file, s")
    ] = 300
    step_place: Annotated[
        float, _describe("a coordinate of a point in a STEP file, units of the file")
    ] = 1e9
    model_bytes: Annotated[
        float, _describe("bytes that the model of a 3MF file unpacks to; nothing else is unpacked")
    ] = 1_000_000_000
    accessor: Annotated[
        float, _describe("elements of an accessor of a GLB file for each byte of the file")
    ] = 1
    gcode_steps: Annotated[
        float,
        _describe(
            "lines that a G-code program runs in loops and subroutines, beyond those of its text"
        ),
    ] = 500_000
    gcode_motions: Annotated[
        float, _describe("instructions of a G-code program beyond its lines")
    ] = 3_000_000
    gcode_pieces: Annotated[
        float, _describe("holes of one line of G-code, pecks of a hole, pieces of an arc")
    ] = 20_000
    pacscript_steps: Annotated[
        float, _describe("statements that a PacScript program runs beyond those of its text")
    ] = 500_000
    rapid_steps: Annotated[
        float, _describe("statements that a RAPID program runs beyond the lines of its text")
    ] = 200_000
    vplus_steps: Annotated[
        float,
        _describe(
            "instructions that a V+ program runs in loops and subroutines, beyond those of its text"
        ),
    ] = 200_000
    urdf_bytes: Annotated[float, _describe("bytes of a URDF")] = 8_000_000
    urdf_joints: Annotated[float, _describe("joints of an arm in a URDF", 100)] = 12


def format_limit(value: float) -> str:
    """A limit as text for a message.

    >>> format_limit(1e6), format_limit(0.01), format_limit(1e-6)
    ('1,000,000', '0.01', '1e-06')
    """
    return f"{value:,.10g}"
