"""The operations of a job by FreeCAD's Path workbench, run by the Python that FreeCAD is installed for:

    python3 peer_freecad.py OPERATIONS.json FOLDER

OPERATIONS.json is what ``bench.check.peer`` writes. Each operation is posted for LinuxCNC by itself, to FOLDER/K.ngc.
The last line that is printed is JSON: seconds of the work and what was not made. It belongs to no package: FreeCAD's
Python has none of camgen.
"""

import json
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))

from freecad_peer import FreeCAD, Part, chosen, make_face
from PathScripts import (
    PathDressupHoldingTags,
    PathDrilling,
    PathJob,
    PathProfile,
    PathToolController,
)
from PathScripts.post import linuxcnc_post


def extrude(loop, depth):
    return make_face(loop).extrude(FreeCAD.Vector(0, 0, -depth))


def share_out(operation):
    """The loops of each profile with the side of the tool: one for each loop that tags hold, since their number is that
    of a whole profile.
    """
    for side, loops in operation.get("sides", {}).items():
        yield from ((side, [loop]) for loop in loops) if operation["tabs"] else [(side, loops)]


def add_model(document, loops, depth):
    """A compound of a solid for each loop."""
    shape = Part.makeCompound([extrude(loop, depth) for loop in loops])
    model = document.addObject("Part::Feature", "Loops")
    model.Shape = shape
    return model


def top_faces(model):
    """The names of its faces at z = 0."""
    return [f"Face{k}" for k, face in enumerate(model.Shape.Faces, 1) if face.BoundBox.ZMin > -1e-6]


def add_tool(job, tool):
    control = PathToolController.Create(tool["name"], toolNumber=tool["number"])
    control.Tool.Diameter = tool["diameter"]
    control.HorizFeed = f"{tool['feed']} mm/s"
    control.VertFeed = f"{tool['plunge']} mm/s"
    control.SpindleSpeed, control.SpindleDir = tool["speed"], "Forward"
    job.Proxy.addToolController(control)
    return control


def set_levels(made, operation, tool):
    """Depths and heights, mm, in the place of the expressions that give them."""
    heights = {
        "StartDepth": 0.0,
        "FinalDepth": -operation["depth"],
        "SafeHeight": operation["approach"],
    }
    heights["ClearanceHeight"] = operation["clearance"]
    if hasattr(made, "StepDown"):
        heights["StepDown"] = operation["depth"] / operation["passes"]
    for name, value in heights.items():
        made.setExpression(name, None)
        setattr(made, name, value)
    made.ToolController = tool


def drill(operation, tool):
    made = PathDrilling.Create("Drilling")
    made.Base = []
    made.Locations = [FreeCAD.Vector(x, y, 0) for x, y in operation["holes"]]
    set_levels(made, operation, tool)
    made.setExpression("PeckDepth", None)
    made.setExpression("RetractHeight", None)
    made.RetractHeight = operation["approach"]
    made.PeckEnabled = operation["passes"] > 1
    made.PeckDepth = operation["depth"] / operation["passes"]
    return made


def profile(document, operation, tool, model, side):
    made = PathProfile.Create("Profile")
    made.Base = [(model, top_faces(model))]
    made.HandleMultipleFeatures = "Individually"
    made.Side, made.UseComp, made.processPerimeter = side, True, True
    # Climb: counterclockwise inside of holes, clockwise around parts.
    made.Direction = "CCW" if side == "Inside" else "CW"
    set_levels(made, operation, tool)
    document.recompute()
    if not operation["tabs"]:
        return made
    held = PathDressupHoldingTags.Create(made)
    held.Width, held.Height, held.Angle, held.Radius = (
        operation["tab_width"],
        operation["tab_height"],
        90,
        0,
    )
    held.Proxy.generateTags(held, operation["tabs"])
    return held


def main(source, folder):
    begun = time.perf_counter()
    with open(source) as file:
        work = json.load(file)
    document = FreeCAD.newDocument("Template")
    models = [[]] * len(work["operations"])
    for k, operation in enumerate(work["operations"]):
        models[k] = [
            (side, add_model(document, loops, operation["depth"]))
            for side, loops in share_out(operation)
        ]
    every = [model for one in models for _, model in one]
    plate = document.addObject("Part::Box", "Plate")
    document.recompute()
    job = PathJob.Create("Job", every or [plate], None)
    job.GeometryTolerance = work["tolerance"]
    clones = iter(job.Model.Group)
    models = [[(side, next(clones)) for side, _ in one] for one in models]
    tools = [add_tool(job, tool) for tool in work["tools"]]
    chosen.job = job
    failed = []
    for k, operation in enumerate(work["operations"]):
        tool = chosen.tool = tools[operation["tool"]]
        if operation["kind"] == "drill":
            made = [drill(operation, tool)]
        else:
            made = [profile(document, operation, tool, model, side) for side, model in models[k]]
        document.recompute()
        failed += [
            k
            for one in made
            if not any(c.Name in ("G1", "G2", "G3", "G81", "G83") for c in one.Path.Commands)
        ]
        linuxcnc_post.export([tool, *made], f"{folder}/{k}.ngc", "--no-show-editor")
    print(json.dumps({"seconds": time.perf_counter() - begun, "failed": failed}))


main(*sys.argv[1:])
