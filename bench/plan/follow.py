"""`follow` on real drawings, judged from the printed text.

    python -m bench.plan.follow [FOLDER | FILE DIAMETER]

Every point at which the tool works must be at the tool radius from the drawing, and no point of a
path nearer. The drawings, FILE or those of FOLDER that are named here, are flattened by ezdxf, not
by camgen's reader; the points come from the text of each post, read back. Exits with 1 if a figure
misses its goal.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import ezdxf
import numpy as np
import shapely
from ezdxf.disassemble import recursive_decompose
from ezdxf.entities import DXFEntity

import camgen
from bench.support.motions import sample_motion
from bench.support.runner import SHARED, Cells, Scenario, run, verdict
from camgen.model.program import Instruction, MoveC, MoveL, Output
from camgen.post.plugins import find_readback

COLUMNS = (
    "drawing | tool mm {:g} | paths | working points off mm {:.4f} | nearer than allowed mm {:.4f} "
    "| posts apart mm {:.4f} | arcs: instr./m {:.0f} | chords: instr./m {:.0f} | "
)
POSTS = ("rapid", "pacscript", "vplus", "gcode", "grbl")
GOAL = 0.02
#: Drawings of closed loops only, and a tool that fits most of them, mm.
DRAWINGS = {
    "trimesh/1002_tray_bottom.DXF": 2.0,
    "trimesh/125_cycloidal.DXF": 1.0,
    "trimesh/LM2.dxf": 3.0,
    "trimesh/apu-mount.DXF": 2.0,
    "trimesh/ChuteHolderPrint.DXF": 1.5,
    "trimesh/insert.dxf": 6.0,
    "trimesh/spline.DXF": 6.0,
    "trimesh/sliding-base.dxf": 6.0,
    "trimesh/uc.r12b.dxf": 0.2,
    "trimesh/uc.r2013b.dxf": 6.0,
    "ezdxf/forms.dxf": 6.0,
    "ezdxf/issue_1359_1.dxf": 6.0,
    "dxf/issue42.dxf": 2.0,
    "dxf/issue27c.dxf": 1.0,
    "dxf/squircle2.dxf": 3.0,
    "cadquery/gear.dxf": 1.0,
    "cadquery/MC 12x31.dxf": 6.0,
    "SofleKeyboard/SofleKeyboardTopPlate_ShapeOnly.dxf": 3.0,
    "SofleKeyboard/sofle_pico_key_plate_v3.5.5.dxf": 2.0,
    "SofleKeyboard/OLED_Cover.dxf": 2.0,
    "redox-keyboard/redox_rev1-brd.dxf": 0.1,
}
CURVES = {"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE", "INSERT"}
UNITS = {0: 1.0, 1: 25.4, 4: 1.0, 5: 10.0, 6: 1000.0}


def drawn_by_ezdxf(file: Path) -> shapely.STRtree:
    """The drawing in mm as short straight lines, without camgen's reader."""
    document = ezdxf.readfile(file)
    scale = UNITS[int(document.header.get("$INSUNITS", 0))]
    lines = []
    for whole in document.modelspace():
        if whole.dxftype() in CURVES:
            for entity in pieces(whole):
                points = flattened(entity, 0.0005 / scale) * scale
                lines += [shapely.LineString(points[k : k + 2]) for k in range(len(points) - 1)]
    return shapely.STRtree(lines)


def pieces(whole: DXFEntity) -> Iterator[DXFEntity]:
    """Lines, arcs and the like out of blocks and polylines."""
    for entity in recursive_decompose([whole]):
        if entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
            yield from entity.virtual_entities()
        else:
            yield entity


def flattened(entity: DXFEntity, sagitta: float) -> np.ndarray:
    """Points on a curve. A path of Bezier curves would leave circles by r / 3700."""
    if entity.dxftype() in ("CIRCLE", "ARC", "ELLIPSE", "SPLINE"):
        return np.array([(p.x, p.y) for p in entity.flattening(sagitta)])
    if entity.dxftype() == "LINE":
        return np.array([(p.x, p.y) for p in (entity.dxf.start, entity.dxf.end)])
    return np.zeros((0, 2))


def sample_working(body: tuple[Instruction, ...]) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Targets and dense samples of the motions with the process on, their number, and length, m."""
    is_on, position = False, np.zeros(3)
    targets, samples, count, length = [], [], 0, 0.0
    for item in body:
        if isinstance(item, Output):
            is_on = item.value > 0
        elif isinstance(item, (MoveL, MoveC)):
            end = np.array(item.target.origin)
            if is_on:
                points = sample_instruction(position, item)
                targets += [points[0], end]
                samples.append(points)
                count += 1
                length += float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) / 1000
            position = end
        elif isinstance(getattr(item, "target", None), camgen.Pose):
            position = np.array(item.target.origin)
    return np.array(targets)[:, :2], np.concatenate(samples)[:, :2], count, length


def sample_instruction(start: np.ndarray, item: MoveL | MoveC) -> np.ndarray:
    """Points of a line 0.2 mm apart at most, or of an arc 0.1 mm, since its chords count."""
    end = np.array(item.target.origin)
    if isinstance(item, MoveL):
        return sample_motion(start, None, end, 0.2)
    return sample_motion(start, np.array(item.via.origin), end, 0.1)


def measure_gaps(points: np.ndarray, tree: shapely.STRtree) -> np.ndarray:
    index = tree.nearest(shapely.points(points))
    return shapely.distance(shapely.points(points), tree.geometries[index])


def index_lines(points: np.ndarray) -> shapely.STRtree:
    """The lines from point to point."""
    return shapely.STRtree(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))


def measure(file: Path, diameter: float) -> Iterator[Cells]:
    """The row of a drawing."""
    tree = drawn_by_ezdxf(file)
    job = {"tool": {"diameter": diameter}}
    reference = None
    errors, inside, counts, distance = [], [], {}, 0.0
    for post in POSTS:
        result = camgen.build(file, post=post, job=job)
        reading = find_readback(post)({f.name: f.text for f in result.files}, {})
        targets, samples, counts[post], metres = sample_working(reading.body)
        errors.append(np.abs(measure_gaps(targets, tree) - diameter / 2).max())
        inside.append((diameter / 2 - measure_gaps(samples, tree)).max())
        if reference is None:
            reference = index_lines(samples)
        distance = max(distance, float(measure_gaps(samples, reference).max()))
    worst = max(errors), max(0.0, *inside), distance
    density = counts["rapid"] / metres, counts["vplus"] / metres
    is_met = max(worst) <= GOAL
    yield file.name, diameter, len(result.tour.paths), *worst, *density, verdict(is_met)


def inputs(words: list[str]) -> list[tuple[Path, float]]:
    """File and diameter of the tool (mm) of each drawing."""
    folder = Path(words[0]) if words else SHARED / "dxf"
    if folder.is_file():
        return [(folder, float(words[1]))]
    return [(folder / name, diameter) for name, diameter in DRAWINGS.items()]


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(run(Scenario(COLUMNS, inputs(sys.argv[1:]), measure)))
