"""The tables of a job file, with defaults. Units are mm, deg, mm/s, N and s.

These structures are the one place where a setting has a name, a type, a default and a description.
`camgen init` prints them, and the reader of job files checks a file against them. This module does
not import `annotations` from `__future__`: annotations that are texts would be compiled on every
start, which takes 10 ms.
"""

import math
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, field

from camgen.model.limits import Limits

#: Settings of `[process]` and `[[tools]]` that are speeds of the tool: numbers in mm/s, or texts
#: with a unit.
SPEEDS = ("feed", "plunge", "max_feed", "travel")
#: mm/s in each unit of speed.
SPEED_UNITS = {"mm/s": 1.0, "mm/min": 1 / 60, "m/min": 1000 / 60, "in/min": 25.4 / 60, "in/s": 25.4}
#: mm: default clearance height on a page. A pen that is lifted less returns sooner.
PAGE_CLEARANCE = 3.0
#: mm2: largest area of a chip of any tool.
_LARGEST_CHIP_MM2 = 100.0
#: mm/s: default speed of links.
_TRAVEL_MM_S = 100.0

Positive = Annotated[float, Meta(gt=0)]
#: mm/s: the fastest speeddata that a controller of arms has (v7000 of RAPID). No mill is faster.
FASTEST = 7000.0
#: A speed of a tool, mm/s.
Speed = Annotated[float, Meta(gt=0, le=FASTEST)]
Share = Annotated[float, Meta(gt=0, le=1)]
NotNegative = Annotated[float, Meta(ge=0)]
Grey = Annotated[float, Meta(ge=0, le=255)]
Angle = Annotated[float, Meta(gt=0, lt=180)]
MaterialName = Literal[
    "aluminium",
    "brass",
    "steel",
    "stainless steel",
    "acrylic",
    "plywood",
    "mdf",
    "hardwood",
    "softwood",
]
Values = list[float]
Points = list[list[float]]
#: Each from corner to corner.
Boxes = list[list[float]]


class Table(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all tables."""


class InputTable(Table, frozen=True):
    """[input]: how the file is read."""

    units: Annotated[
        str,
        Meta(description="unit of the drawing: auto (the file's own), mm, cm, m, inch, ft, ..."),
    ] = "auto"
    layers: Annotated[list[str], Meta(description='layers to use, as globs; "!x" leaves out')] = (
        field(default_factory=lambda: ["*"])
    )
    origin: Annotated[
        Literal["", "lower-left", "lower-right", "upper-left", "upper-right", "center"] | Values,
        Meta(
            description="moves a drawing: this corner, the center, or a point [x, y] mm of it is "
            'x 0, y 0; "": it stays'
        ),
    ] = ""
    join: Annotated[NotNegative, Meta(description="ends closer than this meet, mm")] = 0.05
    min_length: Annotated[
        NotNegative, Meta(description="shorter contours are dropped and counted, mm")
    ] = 0.0
    select: Annotated[
        str,
        Meta(
            description="edges of a 3-D part: convex, all, bottom, ids as inspect prints them; "
            '"not" leaves out'
        ),
    ] = "convex"
    dialect: Annotated[
        Literal["", "linuxcnc", "grbl", "fanuc", "fanuc-lathe", "mach3", "marlin", "iso"],
        Meta(
            description='of G-code: the controller that it was written for; "": recognised by '
            "its words"
        ),
    ] = ""
    assume: Annotated[
        dict[str, float],
        Meta(
            description="of programs: values that are not in their text, by the keys that `camgen "
            "verify` names, { di1 = 1 }"
        ),
    ] = field(default_factory=dict)
    signals: Annotated[
        dict[str, str],
        Meta(description='of programs: other names for their outputs, { aoSpindle = "spindle" }'),
    ] = field(default_factory=dict)


class ImageTable(Table, frozen=True):
    """[image]: a picture of a part, its scale, and how the part is found in it."""

    mm_per_px: Annotated[
        Positive | None, Meta(description="scale of a picture that is seen straight from above")
    ] = None
    width_mm: Annotated[Positive | None, Meta(description="or the width of that picture, mm")] = (
        None
    )
    region: Annotated[
        Values | None,
        Meta(
            description="area of the picture that is read: [x from, y from, x to, y to], mm of the "
            "work plane"
        ),
    ] = None
    tones: Annotated[
        Literal["linear", "srgb"],
        Meta(
            description="linear: values in proportion to the light, as from cameras for machine "
            "vision; srgb: coded, as from most others"
        ),
    ] = "linear"
    mask: Annotated[
        Literal["auto", "otsu", "threshold", "color", "background", "adaptive", "alpha"],
        Meta(
            description="the method that separates the part from the bench; auto chooses one and "
            "says why"
        ),
    ] = "auto"
    background: Annotated[
        str, Meta(description="photo of the empty bench, taken from the same place")
    ] = ""
    lamp_moved: Annotated[
        str,
        Meta(
            description="second photo from the same place with the lamp moved: a shadow in only "
            "one of the two is left out"
        ),
    ] = ""
    threshold: Annotated[
        Grey | None,
        Meta(description="grey level between bench and part, 0 to 255, for mask = threshold"),
    ] = None
    color: Annotated[
        Values | None, Meta(description="color of the bench or of the part: [red, green, blue]")
    ] = None
    invert: Annotated[bool, Meta(description="exchanges part and bench")] = False
    lines: Annotated[
        Literal["auto", "centre", "border"],
        Meta(
            description="of a traced drawing: ink along its middle (centre), its borders "
            "(border), or "
            "thin lines and lettering along their middle and the rest along its borders (auto)"
        ),
    ] = "auto"
    min_area: Annotated[
        NotNegative, Meta(description="smaller specks and holes are dropped and counted, mm2")
    ] = 1.0
    accept: Annotated[
        list[Literal["outside", "specks", "edges"]],
        Meta(
            description="doubts to build in spite of. outside: a part beside the points or corners "
            "of the work plane, without camera.file. specks: small things as parts. edges: "
            "outlines without an edge in the grey picture, or of a shadow alone"
        ),
    ] = []


class CameraTable(Table, frozen=True):
    """[camera]: the lens of a photo, and where the work plane is in it."""

    file: Annotated[
        str, Meta(description="calibration: camgen calibrate's, camera_info of ROS, or OpenCV's")
    ] = ""
    points_px: Annotated[
        Points | None, Meta(description="four or more places in the photo: [[u, v], ...]")
    ] = None
    points_mm: Annotated[
        Points | None, Meta(description="the same places in the work frame: [[x, y], ...], mm")
    ] = None
    plane_from: Annotated[
        Values | None,
        Meta(
            description="or the pose of the work frame in the camera frame: [x, y, z, rx, ry, "
            "rz], mm and deg"
        ),
    ] = None
    markers: Annotated[
        str,
        Meta(
            description='or the sheet on the bench: camgen markers, "A4", or a ChArUco board, "7x5"'
        ),
    ] = ""
    marker: Annotated[Positive, Meta(description="width of the markers of sheet or board, mm")] = (
        20.0
    )
    square: Annotated[Positive, Meta(description="width of the squares of a ChArUco board, mm")] = (
        30.0
    )
    printed_length: Annotated[
        Positive, Meta(description="measured length of the ruler on the printed sheet, mm")
    ] = 100.0
    height: Annotated[
        float, Meta(description="height of the part's top face above points or markers, mm")
    ] = 0.0


class OperationTable(Table, frozen=True):
    """[operation]: the operation along the contours, with its settings."""

    kind: Annotated[
        Literal[
            "auto",
            "follow",
            "trace",
            "fill",
            "pocket",
            "bore",
            "chamfer",
            "drill",
            "edges",
            "replay",
        ],
        Meta(
            description="follow: the tool runs beside the contour; trace: its centre runs on the "
            "line; fill: it covers closed contours; pocket: it clears them, from the middle "
            "outwards; bore: circles larger than the tool, on a helix; chamfer: edges, with a V "
            "tool; drill: marks, rings and circles; edges: of a 3-D part; replay: a G-code or "
            "robot program; auto: by the input"
        ),
    ] = "auto"
    options: Annotated[
        dict[str, Any], Meta(description="settings of an operation of another package")
    ] = {}
    side: Annotated[
        Literal["auto", "outside", "inside", "left", "right", "on"],
        Meta(
            description="auto: outer loops outside, holes inside; left, right, on: seen along the "
            "drawn direction"
        ),
    ] = "auto"
    planner: Annotated[
        Literal["geometric", "image"],
        Meta(
            description="follow a photo by lines and arcs found in it, or in image space as the "
            "PIST paper does"
        ),
    ] = "geometric"
    waypoint_spacing: Annotated[
        Positive | None,
        Meta(
            description="image planner: between waypoints before the redundant ones go, mm, a "
            "pixel at least; not set: by tolerance.chord"
        ),
    ] = None
    waypoint_turn: Annotated[
        Positive,
        Meta(
            description="image planner: waypoints where the force direction turns by less are "
            "redundant, deg/mm"
        ),
    ] = 2.0
    direction: Annotated[
        Literal["climb", "conventional", "any"],
        Meta(description="climb: the part on the right of the travel"),
    ] = "climb"
    corner_radius: Annotated[
        NotNegative, Meta(description="smallest radius of inner corners of the path, mm")
    ] = 0.0
    inside_first: Annotated[bool, Meta(description="holes before the outline around them")] = True
    shared: Annotated[
        Literal["once", "each"],
        Meta(
            description="trace: edges that several contours share are run once, or with each "
            "of them"
        ),
    ] = "once"
    stepover: Annotated[
        float,
        Meta(
            gt=0,
            le=1,
            description="fill, pocket: distance between passes, as a share of the tool's diameter",
        ),
    ] = 0.7
    engagement: Annotated[
        Share | None,
        Meta(
            description="pocket: largest width of the tool in the material, as a share of its "
            "diameter; 1: no bound; not set: 0.15 more than stepover",
        ),
    ] = None
    width: Annotated[
        Positive | None, Meta(description="chamfer: its width, seen from above, mm")
    ] = None
    finish: Annotated[
        NotNegative,
        Meta(
            description="material left at the walls, mm, which a last pass at the whole depth "
            "removes; 0: none"
        ),
    ] = 0.0
    rest: Annotated[
        bool,
        Meta(
            description="follow, pocket: only what operations listed before it for the same "
            "contours leave, as a larger tool does in inner corners"
        ),
    ] = False
    holes: Annotated[
        Values | None,
        Meta(
            description="drill, bore: the diameters that are worked on, [from, to] mm; not set: all"
        ),
    ] = None
    depth: Annotated[
        NotNegative, Meta(description="depth of the tool tip below the top face, mm")
    ] = 0.0
    passes: Annotated[int, Meta(ge=1, description="number of equal passes to the depth")] = 1
    entry: Annotated[
        Literal["plunge", "ramp", "helix"],
        Meta(
            description="how the tool goes into the material; plunge: straight down; ramp: along "
            "the path, down by "
            "entry_angle; helix: pockets and bores on a helix, other paths by a ramp"
        ),
    ] = "plunge"
    entry_angle: Annotated[
        float, Meta(gt=0, le=45, description="angle of a ramp or a helix to the work plane, deg")
    ] = 3.0
    tabs: Annotated[
        int,
        Meta(
            ge=0,
            description="bridges on each closed outline that is cut out; without one on each hole",
        ),
    ] = 0
    tab_spacing: Annotated[
        Positive | None,
        Meta(description="or length of the outline for each bridge, mm; two bridges at least"),
    ] = None
    tab_width: Annotated[Positive, Meta(description="length of a bridge along the contour, mm")] = (
        5.0
    )
    tab_height: Annotated[
        Positive, Meta(description="height of a bridge above the depth of the operation, mm")
    ] = 1.0
    lead_in: Annotated[
        NotNegative, Meta(description="length of the lead-in to a followed contour, mm")
    ] = 0.0
    lead_out: Annotated[NotNegative, Meta(description="length of the lead-out, mm")] = 0.0
    overlap: Annotated[
        NotNegative, Meta(description="length run twice at the seam of a closed contour, mm")
    ] = 0.0
    offset: Annotated[
        NotNegative, Meta(description="distance of the tool tip from the edges of a 3-D part, mm")
    ] = 0.0
    trim: Annotated[
        NotNegative,
        Meta(
            description="length at either end of an edge that may be left out without being "
            "reported as skipped, mm"
        ),
    ] = 0.0
    offset_along: Annotated[
        Literal["mean", "burr"],
        Meta(
            description="mean: between the two faces of an edge; burr: off the face machined last"
        ),
    ] = "mean"
    last_face: Annotated[
        str | Values,
        Meta(
            description='burr: "top": of two faces the one that faces up more was machined last; '
            "[x, y, z]: the one that faces this direction more; ids of faces as inspect prints "
            "them: after all others, in this order"
        ),
    ] = "top"
    taught_on: Annotated[
        str,
        Meta(
            description="replay of a robot program: the arm that it was written for, one of "
            "`camgen robots` or a URDF, whose joint values are converted for the arm of the cell"
        ),
    ] = ""
    compensation: Annotated[
        Literal["exact", "as-programmed"],
        Meta(
            description="replay of G-code: G41 and G42; exact: beside the path by the radius of "
            "the tool; "
            "as-programmed: on it, for programs that hold the path of its centre"
        ),
    ] = "exact"


class ToolTable(Table, frozen=True):
    """[tool]: the tool (cutter, pen, laser) and how it is held."""

    file: Annotated[
        str,
        Meta(
            description="library of tools: a TOML file with [[tools]], which the job changes "
            "by name"
        ),
    ] = ""
    name: Annotated[str, Meta(description="its name, by which operations choose it")] = ""
    number: Annotated[
        int, Meta(ge=0, le=99_999, description="its number in the machine's tool table; 0: none")
    ] = 0
    kind: Annotated[
        Literal[
            "end mill", "ball mill", "bull nose", "drill", "v", "laser", "plasma", "knife", "pen"
        ],
        Meta(description="its shape, from which the rest material follows"),
    ] = "end mill"
    corner_radius: Annotated[NotNegative, Meta(description="of a bull nose mill, mm")] = 0.0
    tip_angle: Annotated[
        Angle | None, Meta(description="whole angle at the tip, deg; not set: v 90, drill 118")
    ] = None
    tip_diameter: Annotated[NotNegative, Meta(description="flat at the tip of a V tool, mm")] = 0.0
    flutes: Annotated[
        int,
        Meta(ge=1, description="number of cutting edges, by which the feed of a tooth is checked"),
    ] = 2
    material: Annotated[
        Literal["carbide", "hss"] | None,
        Meta(description="of the cutting edges; not set: carbide, of a drill hss"),
    ] = None
    cutting_length: Annotated[
        Positive | None,
        Meta(description="length of the cutting edges along the axis, mm; not set: not checked"),
    ] = None
    center_cutting: Annotated[
        bool,
        Meta(
            description="an end mill or a bull nose cuts over its centre: it may go straight down"
        ),
    ] = False
    max_speed: Annotated[
        Positive | None, Meta(description="highest speed of the spindle, rpm; not set: any")
    ] = None
    diameter: Annotated[Positive, Meta(description="cutting diameter, mm")] = 6.0
    length: Annotated[
        NotNegative, Meta(description="length from the flange to the tool tip, mm")
    ] = 100.0
    orient: Annotated[
        Literal["fixed", "follow"],
        Meta(description="follow: tool x turns with the contour normal, towards the part"),
    ] = "fixed"
    axis_tilt: Annotated[
        float, Meta(ge=0, le=60, description="largest lean of the axis to reach an edge, deg")
    ] = 0.0
    symmetric: Annotated[
        bool,
        Meta(description="an arm may choose any turn of the tool about its axis"),
    ] = False
    turn: Annotated[
        Values | None,
        Meta(
            description="or the multiples of the step between from and to: [from, to, step], "
            "deg; 0 is "
            "the nominal turn"
        ),
    ] = None
    axis: Annotated[
        Literal["auto", "fixed", "given", "normal"],
        Meta(
            description="along a curve in space; fixed: by angles; given: by the angles of the "
            "points; normal: square to the nearest face of a part; auto: given where there are "
            "angles, else fixed"
        ),
    ] = "auto"
    angles: Annotated[
        Values | None,
        Meta(
            description="a fixed tool in the work frame: [rx, ry, rz], deg; not set: straight "
            "down, [180, 0, 0]"
        ),
    ] = None
    holder: Annotated[
        Boxes | None,
        Meta(
            description="the parts between flange and tool, as boxes at the flange: [[x, y, z, "
            "x, y, z], ...], mm"
        ),
    ] = None

    @property
    def radius(self) -> float:
        """Radius at which the tool cuts, mm."""
        return self.diameter / 2

    @property
    def chip_area(self) -> float:
        """Area, mm2, below which a slug passes beside the tool with the chips.

        It is that of the tool's cross-section, and at most `_LARGEST_CHIP_MM2`. A larger slug gets
        between the tool and the wall: it is thrown, or breaks the tool.
        """
        return min(_LARGEST_CHIP_MM2, math.pi * self.radius**2)

    @property
    def edges(self) -> Literal["carbide", "hss"]:
        """The material of the cutting edges."""
        return self.material or ("hss" if self.kind == "drill" else "carbide")


class ToolRow(ToolTable, frozen=True):
    """[[tools]]: tools that operations name; keys as in [tool], and what they cut with."""

    feed: Annotated[
        Speed | None, Meta(description="process.feed of operations with this tool, mm/s")
    ] = None
    plunge: Annotated[
        Speed | None, Meta(description="process.plunge of operations with this tool, mm/s")
    ] = None
    speed: Annotated[
        NotNegative | None, Meta(description="process.spindle of operations with this tool, rpm")
    ] = None


class ProcessTable(Table, frozen=True):
    """[process]: speeds, force, heights and the signal."""

    feed: Annotated[
        Speed, Meta(description="speed of the contact point along the contour, mm/s")
    ] = 20.0
    force: Annotated[NotNegative, Meta(description="force against the contour, N; 0: off")] = 0.0
    plunge: Annotated[
        Speed | None,
        Meta(
            description="speed from the approach down to the contact, mm/s; not set: a third "
            "of the "
            "feed"
        ),
    ] = None
    max_feed_factor: Annotated[
        float,
        Meta(
            ge=1,
            description="maximum speed of the tool centre on outer curves, as a multiple of the "
            "feed",
        ),
    ] = 2.0
    max_feed: Annotated[
        Speed | None,
        Meta(description="replay: feeds above it become this, mm/s; not set: no feed is changed"),
    ] = None
    travel: Annotated[
        Speed | None,
        Meta(
            description="speed between contours, mm/s; not set: 100, and 250 for each point of "
            "an arm "
            "in free space"
        ),
    ] = None
    acceleration: Annotated[
        Positive | None,
        Meta(
            description="of the machine, mm/s2: for the time, and for rounded corners of V+ and "
            "PacScript; not set: by its post"
        ),
    ] = None
    turn: Annotated[
        Positive, Meta(description="speed of reorientations at a fixed tool tip, deg/s")
    ] = 60.0
    approach: Annotated[
        NotNegative, Meta(description="height above the start where the feed begins, mm")
    ] = 2.0
    retract: Annotated[
        Positive,
        Meta(description="height above the top face after pressing, mm"),
    ] = 5.0
    clearance: Annotated[
        NotNegative,
        Meta(
            description="clearance height above the top face, mm; on a page 3 if not given; 0: "
            "none, for marks that the tool does not touch"
        ),
    ] = 20.0
    stay_down: Annotated[
        bool,
        Meta(
            description="no lift where the straight link is clear of part and fixtures; for jobs "
            "without stock"
        ),
    ] = False
    spindle: Annotated[
        NotNegative, Meta(description="spindle speed for the whole program, rpm; 0: off")
    ] = 0.0
    signal: Annotated[
        str,
        Meta(
            description='output that is on along a contour; "auto": process unless a spindle runs; '
            '"": none'
        ),
    ] = "auto"
    switch: Annotated[
        Literal["auto", "contact", "air"],
        Meta(
            description="where the signal is switched; contact: on the part, for a laser, a plasma "
            "torch or a pen; air: above it, for a tool that turns; auto: air with a depth or a "
            "force"
        ),
    ] = "auto"
    dwell: Annotated[
        NotNegative, Meta(description="wait after the signal or the spindle is switched on, s")
    ] = 0.0

    @property
    def travel_speed(self) -> float:
        """Speed of links near the part, mm/s; in free space it may be higher."""
        return self.travel or _TRAVEL_MM_S

    @property
    def least_height(self) -> float:
        """Lowest height of the TCP above the top face on joint motions between paths, mm.

        It is -inf if any height is allowed.
        """
        return min(self.approach, self.clearance / 2) if self.clearance > 0 else -math.inf


class Choice(Table, frozen=True):
    """[[operations]]: one operation after the other, each with its tool and its contours. It may
    also have all keys of [operation] and [process], else it has their values.
    """

    tool: Annotated[
        str | int, Meta(description="name or number of one of [[tools]]; not set: [tool]")
    ] = ""
    layers: Annotated[list[str], Meta(description='its layers, as globs; "!x" leaves out')] = field(
        default_factory=lambda: ["*"]
    )
    colors: Annotated[
        list[str],
        Meta(description='its colors: names ("red"), numbers of DXF ("1") or "#ff0000"; none: all'),
    ] = field(default_factory=list)
    ids: Annotated[
        list[str], Meta(description="these contours, as inspect -v prints them; none: all")
    ] = field(default_factory=list)
    nesting: Annotated[
        Literal["any", "outer", "inner"],
        Meta(
            description="outer: contours that no other one of the drawing encloses; inner: those "
            "that one does"
        ),
    ] = "any"


class Step(Table, frozen=True):
    """One operation of a job with several: its tool, its complete settings and its contours."""

    tool: ToolTable
    operation: OperationTable
    process: ProcessTable
    choice: Choice


class StockTable(Table, frozen=True):
    """[stock]: the material that the part is cut from; its top face is z = 0."""

    thickness: Annotated[Positive | None, Meta(description="mm; not set: unknown")] = None
    below: Annotated[
        NotNegative,
        Meta(description="how far a cut may end below the stock, without a drill's tip, mm"),
    ] = 0.5
    material: Annotated[
        MaterialName | None,
        Meta(description="by which feeds and speeds are checked; not set: by the largest of all"),
    ] = None
    margin: Annotated[NotNegative, Meta(description="material around the drawing's size, mm")] = (
        10.0
    )
    layer: Annotated[
        str, Meta(description="or the layer on which the stock's own outline is drawn")
    ] = ""
    held: Annotated[
        Literal["frame", "vacuum", "tape"],
        Meta(description="hold of pieces that are cut free; frame: tabs or a skin alone"),
    ] = "frame"


class TourTable(Table, frozen=True):
    """[tour]: the order of the contours."""

    method: Annotated[
        Literal["best", "nearest", "as-drawn"],
        Meta(description="best: the shortest travel that camgen finds"),
    ] = "best"
    seconds: Annotated[
        NotNegative,
        Meta(
            description="s of a clock until the search ends; 0: a fixed number of evaluations, the "
            "same on every machine"
        ),
    ] = 0.0
    seed: Annotated[
        int, Meta(ge=0, description="seed of the search; another number gives another search")
    ] = 0
    layers: Annotated[
        list[str],
        Meta(description="layers in the order in which they are run; others come last"),
    ] = field(default_factory=list)
    seam: Annotated[
        Literal["any", "smooth"],
        Meta(description="where closed contours may begin; smooth: off their corners"),
    ] = "any"
    seams: Annotated[
        Points,
        Meta(
            description="or points where some begin: [[x, y], ...], mm of the work frame; each "
            "is for "
            "the nearest closed path, or for all of the nearest contour"
        ),
    ] = field(default_factory=list)
    order: Annotated[
        list[str],
        Meta(
            description="contours that are run first, in this order, by their ids as inspect -v "
            "prints them"
        ),
    ] = field(default_factory=list)


class PageTable(Table, frozen=True):
    """[page]: the paper of a drawing job; the work frame is at its lower left corner."""

    size: Annotated[
        str | Values,
        Meta(
            description='"A4", "A3 landscape", "letter", ... or [width, height] in mm; "": no page'
        ),
    ] = ""
    margin: Annotated[NotNegative, Meta(description="blank border, mm")] = 10.0
    scale: Annotated[
        Literal["fit", "true"] | Positive,
        Meta(
            description="fit: as large as the page allows; true: as the input says; or mm per unit "
            "or pixel of it"
        ),
    ] = "fit"


class DrawnFixture(Table, frozen=True):
    """Clamps that the drawing of the part shows: the closed outlines of a layer.

    layer: name of the layer; case does not matter.
    top: height of their highest place, z in mm.
    bottom: height of their lowest place, z in mm.
    """

    layer: str
    top: float
    bottom: float = 0.0


class CellTable(Table, frozen=True):
    """[cell]: where the work and the tool are. Without it the post's built-in cell is used."""

    file: Annotated[
        str,
        Meta(
            description="another TOML file, whose [cell] holds the settings that are missing here"
        ),
    ] = ""
    robot: Annotated[
        str,
        Meta(
            description='the arm that runs the program: one of camgen robots, or FILE.urdf; "": '
            "not checked"
        ),
    ] = ""
    machine: Annotated[
        str,
        Meta(description="settings of a mill: a saved $$ listing of GRBL, or a LinuxCNC .ini"),
    ] = ""

    base_from_work: Annotated[
        Values | None,
        Meta(description="work frame in the robot's base: [x, y, z, rx, ry, rz], mm and deg"),
    ] = None
    flange_from_tool: Annotated[
        Values | None,
        Meta(description="tool frame at the flange: [x, y, z, rx, ry, rz], mm and deg"),
    ] = None
    home: Annotated[
        Values | None, Meta(description="joint values of the first and last position, deg")
    ] = None
    joint_speeds: Annotated[
        Values | None,
        Meta(description="maximum speeds of the joints, deg/s or mm/s; not set: the robot's own"),
    ] = None
    joint_accelerations: Annotated[
        Values | None,
        Meta(
            description="accelerations of the joints, deg/s2 or mm/s2; not set: full speed in the "
            "time that the post assumes"
        ),
    ] = None
    fixtures: Annotated[
        list[list[float] | str | DrawnFixture] | None,
        Meta(
            description="clamps, vices and other obstacles: boxes [x, y, z, x, y, z], mm, or mesh "
            "files, in the work frame, or the closed outlines of a layer, "
            '{ layer = "CLAMPS", top = 9.0, bottom = 0.0 }; travel of a mill passes over them'
        ),
    ] = None
    rests_on: Annotated[
        Values | None,
        Meta(
            description="outward normal [x, y, z] of the face on which a 3-D part rests, work "
            "frame; not set: the lowest side, [0, 0, -1]"
        ),
    ] = None
    safety: Annotated[
        NotNegative,
        Meta(
            description="height of links above part and fixtures, for edges and on a mill over "
            "fixtures, mm"
        ),
    ] = 10.0
    margin: Annotated[
        NotNegative,
        Meta(
            description="distance of arm, holder and tool from all bodies, except at the "
            "contact, mm"
        ),
    ] = 2.0


class ToleranceTable(Table, frozen=True):
    """[tolerance]: how far curves may be left."""

    chord: Annotated[
        Positive, Meta(description="deviation of lines and arcs from the drawn curve, mm")
    ] = 0.01
    arc_fit: Annotated[
        NotNegative,
        Meta(description="largest deviation of an arc that replaces short lines, mm; 0: they stay"),
    ] = 0.01
    corner: Annotated[
        NotNegative | None,
        Meta(
            description="largest rounding of a corner that the tool passes without a stop, mm; not "
            "set: a twentieth of tool.diameter, 0.05 at most, to trace or fill, else "
            "tolerance.chord"
        ),
    ] = None
    simplify: Annotated[
        NotNegative | None,
        Meta(
            description="lines are thinned out within this, mm; not set: a third of a pixel of a "
            "traced picture, one pixel of one in two values, else 0"
        ),
    ] = None


class Job(Table, frozen=True):
    """A whole job."""

    input: InputTable = InputTable()
    image: ImageTable = ImageTable()
    camera: CameraTable = CameraTable()
    operation: OperationTable = OperationTable()
    tool: ToolTable = ToolTable()
    process: ProcessTable = ProcessTable()
    tour: TourTable = TourTable()
    page: PageTable = PageTable()
    cell: CellTable = CellTable()
    tolerance: ToleranceTable = ToleranceTable()
    limits: Limits = Limits()
    stock: StockTable = StockTable()
    tools: list[ToolRow] = []
    operations: list[Step] = []
    post: dict[str, object] = {}

    @property
    def drawn_fixtures(self) -> tuple[DrawnFixture, ...]:
        """The entries of `cell.fixtures` that are layers of the drawing."""
        fixtures = self.cell.fixtures or ()
        return tuple(given for given in fixtures if isinstance(given, DrawnFixture))

    @property
    def clamp_layers(self) -> frozenset[str]:
        """The layers of clamps, case folded; nothing on them is machined."""
        return frozenset(drawn.layer.casefold() for drawn in self.drawn_fixtures)

    @property
    def chooses_colors(self) -> bool:
        """Whether an operation selects contours by color."""
        return any(step.choice.colors for step in self.operations)
