"""The operations of a job by FreeCAD's Path workbench, run by the Python of FreeCAD:

    python3 peer_freecad.py OPERATIONS.json FOLDER

``bench.check.peer`` writes OPERATIONS.json. Each operation is posted for LinuxCNC by itself, to
FOLDER/K.ngc. The last line that is printed is JSON: seconds of the work, and the operations without
a path. The script belongs to no package: FreeCAD's Python has none of camgen.
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


def list_profiles(operation):
    """The side of the tool and the loops of each profile.

    A loop with tabs has a profile of its own, since their number is that of a whole profile.
    """
    for side, loops in operation.get("sides", {}).items():
        if operation["tabs"]:
            for loop in loops:
                yield side, [loop]
        else:
            yield side, loops


def add_model(document, loops, depth):
    """A compound of a solid for each loop."""
    shape = Part.makeCompound([extrude(loop, depth) for loop in loops])
    model = document.addObject("Part::Feature", "Loops")
    model.Shape = shape
    return model


def list_top_faces(model):
    """The names of the faces of a model at z = 0."""
    faces = enumerate(model.Shape.Faces, 1)
    return [f"Face{k}" for k, face in faces if face.BoundBox.ZMin > -1e-6]


def add_tool(job, tool):
    control = PathToolController.Create(tool["name"], toolNumber=tool["number"])
    control.Tool.Diameter = tool["diameter"]
    control.HorizFeed = f"{tool['feed']} mm/s"
    control.VertFeed = f"{tool['plunge']} mm/s"
    control.SpindleSpeed, control.SpindleDir = tool["speed"], "Forward"
    job.Proxy.addToolController(control)
    return control


def set_levels(item, operation, tool):
    """Sets the tool, and depths and heights, mm, instead of the expressions that give them."""
    heights = {
        "StartDepth": 0.0,
        "FinalDepth": -operation["depth"],
        "SafeHeight": operation["approach"],
        "ClearanceHeight": operation["clearance"],
    }
    if hasattr(item, "StepDown"):
        heights["StepDown"] = operation["depth"] / operation["passes"]
    for name, value in heights.items():
        item.setExpression(name, None)
        setattr(item, name, value)
    item.ToolController = tool


def drill(operation, tool):
    item = PathDrilling.Create("Drilling")
    item.Base = []
    item.Locations = [FreeCAD.Vector(x, y, 0) for x, y in operation["holes"]]
    set_levels(item, operation, tool)
    item.setExpression("PeckDepth", None)
    item.setExpression("RetractHeight", None)
    item.RetractHeight = operation["approach"]
    item.PeckEnabled = operation["passes"] > 1
    item.PeckDepth = operation["depth"] / operation["passes"]
    return item


def profile(document, operation, tool, model, side):
    item = PathProfile.Create("Profile")
    item.Base = [(model, list_top_faces(model))]
    item.HandleMultipleFeatures = "Individually"
    item.Side, item.UseComp, item.processPerimeter = side, True, True
    # Climb: counterclockwise inside of holes, clockwise around parts.
    item.Direction = "CCW" if side == "Inside" else "CW"
    set_levels(item, operation, tool)
    document.recompute()
    if not operation["tabs"]:
        return item
    held = PathDressupHoldingTags.Create(item)
    held.Width, held.Height = operation["tab_width"], operation["tab_height"]
    held.Angle, held.Radius = 90, 0
    held.Proxy.generateTags(held, operation["tabs"])
    return held


def has_path(item):
    """Whether an operation cuts anything."""
    return any(word.Name in ("G1", "G2", "G3", "G81", "G83") for word in item.Path.Commands)


def main(source, folder):
    start = time.perf_counter()
    with open(source) as file:
        work = json.load(file)
    document = FreeCAD.newDocument("Template")
    models = []
    for number, operation in enumerate(work["operations"]):
        for side, loops in list_profiles(operation):
            models.append((number, side, add_model(document, loops, operation["depth"])))
    plate = document.addObject("Part::Box", "Plate")
    document.recompute()
    job = PathJob.Create("Job", [model for *_, model in models] or [plate], None)
    job.GeometryTolerance = work["tolerance"]
    # The job has a copy of each model.
    copies = zip(models, job.Model.Group, strict=False)
    models = [(number, side, copy) for (number, side, _), copy in copies]
    tools = [add_tool(job, tool) for tool in work["tools"]]
    chosen.job = job
    failed = []
    for number, operation in enumerate(work["operations"]):
        tool = chosen.tool = tools[operation["tool"]]
        if operation["kind"] == "drill":
            items = [drill(operation, tool)]
        else:
            sides = [(model, side) for k, side, model in models if k == number]
            items = [profile(document, operation, tool, *side) for side in sides]
        document.recompute()
        failed += [number for item in items if not has_path(item)]
        linuxcnc_post.export([tool, *items], f"{folder}/{number}.ngc", "--no-show-editor")
    print(json.dumps({"seconds": time.perf_counter() - start, "failed": failed}))


main(*sys.argv[1:])
