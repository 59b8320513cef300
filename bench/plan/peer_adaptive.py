"""An area by FreeCAD's adaptive clearing, run by the Python that FreeCAD is installed for:

    python3 peer_adaptive.py WORK.json OUT.ngc

WORK.json is what ``bench.plan.adaptive`` writes. It belongs to no package: FreeCAD's Python has
none of camgen.
"""

import json
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
from PathScripts import PathAdaptive, PathJob, PathToolController, PathUtils  # noqa: E402
from PathScripts.post import linuxcnc_post  # noqa: E402


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


def face_of(loop):
    return Part.Face(Part.Wire(list(edges(loop["points"], loop["bulges"]))))


def main(source, target):
    with open(source) as file:
        work = json.load(file)
    document = FreeCAD.newDocument("Area")
    area = None
    for loop in sorted(work["loops"], key=lambda loop: loop["depth"]):
        face = face_of(loop)
        if area is None:
            area = face
        else:
            area = area.cut(face) if loop["depth"] % 2 else area.fuse(face)
    model = document.addObject("Part::Feature", "Model")
    model.Shape = area.extrude(FreeCAD.Vector(0, 0, -work["depth"]))
    document.recompute()
    job = PathJob.Create("Job", [model], None)
    control = PathToolController.Create("mill", toolNumber=1)
    control.Tool.Diameter = work["diameter"]
    control.HorizFeed, control.VertFeed = f"{work['feed']} mm/s", f"{work['plunge']} mm/s"
    control.SpindleSpeed, control.SpindleDir = 12000, "Forward"
    job.Proxy.addToolController(control)
    chosen.job, chosen.tool = job, control
    clone = job.Model.Group[0]
    top = [f"Face{k}" for k, f in enumerate(clone.Shape.Faces, 1) if f.BoundBox.ZMin > -1e-6]
    operation = PathAdaptive.Create("Adaptive")
    operation.Base = [(clone, top)]
    operation.Side, operation.OperationType = "Inside", "Clearing"
    operation.StepOver = work["stepover"]
    operation.HelixAngle = work["angle"]
    operation.FinishingProfile = True
    heights = {
        "StartDepth": 0.0,
        "FinalDepth": -work["depth"],
        "SafeHeight": work["approach"],
        "ClearanceHeight": work["clearance"],
        "StepDown": work["depth"] / work["passes"],
    }
    for name, value in heights.items():
        operation.setExpression(name, None)
        setattr(operation, name, value)
    operation.ToolController = control
    document.recompute()
    linuxcnc_post.export([control, operation], target, "--no-show-editor")


main(*sys.argv[1:])
