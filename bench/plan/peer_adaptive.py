"""An area by FreeCAD's adaptive clearing, run by the Python that FreeCAD is installed for:

    python3 peer_adaptive.py WORK.json OUT.ngc

WORK.json is what ``bench.plan.adaptive`` writes. It belongs to no package: FreeCAD's Python has
none of camgen.
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))

from freecad_peer import FreeCAD, chosen, make_face
from PathScripts import PathAdaptive, PathJob, PathToolController
from PathScripts.post import linuxcnc_post


def main(source, target):
    with open(source) as file:
        work = json.load(file)
    document = FreeCAD.newDocument("Area")
    area = None
    for loop in sorted(work["loops"], key=lambda loop: loop["depth"]):
        face = make_face(loop)
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
