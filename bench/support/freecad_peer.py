"""FreeCAD without its window, for the scripts that its Python runs.

A script puts this folder into its module path. FreeCAD's Python has none of camgen.
"""

import math
import sys

HOME = "/usr/lib/freecad/"
SHARE = "/usr/share/freecad/"
sys.path[:0] = [
    SHARE + "Ext", "/usr/lib/freecad-python3/lib", HOME + "lib", SHARE + "Mod",
    *(SHARE + "Mod/" + name for name in ("Path", "Draft", "Part")),
]  # fmt: skip

import FreeCAD  # noqa: E402

# The program without its window looks for its modules beside its own libraries.
FreeCAD.getHomePath = lambda: HOME

import Part  # noqa: E402
from PathScripts import PathUtils  # noqa: E402


class Chosen:
    """The tool and the job that a user would choose in the window."""

    def __init__(self):
        self.tool = self.job = None
        self.selectedToolController = lambda: self.tool
        self.chooseToolController = lambda _: self.tool
        self.chooseJob = lambda _: self.job


chosen = PathUtils.UserInput = Chosen()


def edges(points, bulges):
    """Lines and arcs of a closed loop at z = 0. bulge: tan(sweep / 4), positive to the left."""
    for k, bulge in enumerate(bulges):
        (x, y), (u, v) = points[k], points[(k + 1) % len(points)]
        if math.dist((x, y), (u, v)) < 1e-7:
            continue
        start, end = FreeCAD.Vector(x, y, 0), FreeCAD.Vector(u, v, 0)
        if abs(bulge) < 1e-9:
            yield Part.makeLine(start, end)
        else:
            middle = (x + u) / 2 + bulge * (v - y) / 2, (y + v) / 2 - bulge * (u - x) / 2
            yield Part.Arc(start, FreeCAD.Vector(*middle, 0), end).toShape()


def make_face(loop):
    """The face within a closed loop with `points` and `bulges`."""
    return Part.Face(Part.Wire(list(edges(loop["points"], loop["bulges"]))))
