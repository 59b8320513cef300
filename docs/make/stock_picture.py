"""The picture of docs/stock.md.

python -m docs.make.stock_picture [FOLDER]      writes it into FOLDER (default: docs/images)
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import shapely
from msgspec.structs import replace

from bench.check.scenes import Scene, make_scenes
from camgen.check.stock import Fault, StockProof, prove, show_stay
from camgen.model.pose import Pose
from camgen.model.program import Instruction, MoveL

#: Pixels per mm.
_SCALE = 9.0
#: Colours of the part, of removed material, of inner corners and tabs, of other excess, of gouges.
_STAYS, _GONE, _LEFT, _EXCESS, _GOUGE = "#c9d3dd", "#ffffff", "#f3c56b", "#e67e22", "#d62728"


def damage_body(scene: Scene, distance_mm: float) -> tuple[Instruction, ...]:
    """The body of a scene whose last long line is moved into the part by a distance in x."""
    body = list(scene.cuts[0].body)
    deep_lines = [
        k
        for k, motion in enumerate(body)
        if isinstance(motion, MoveL) and motion.target.origin[2] < -3.9
    ]
    for k in deep_lines[-2:]:
        motion = body[k]
        assert isinstance(motion, MoveL)
        x, y, z = motion.target.origin
        body[k] = replace(motion, target=Pose(motion.target.rotation, (x + distance_mm, y, z)))
    return tuple(body)


def format_path(shape: Any) -> str:
    """The rings of polygons as an SVG path, y up."""
    paths: list[str] = []
    for part in shapely.get_parts(shape):
        if part.geom_type != "Polygon":
            continue
        for ring in (part.exterior, *part.interiors):
            points = " L".join(f"{x:.3f} {-y:.3f}" for x, y in ring.coords)
            paths.append(f"M{points} Z")
    return " ".join(paths)


def draw(scene: Scene, proof: StockProof) -> str:
    """The SVG of the lowest level: part, removed material, excess and gouges."""
    level = proof.levels[-1]
    stays = show_stay(scene.design, -level.bottom)
    low_x, low_y, high_x, high_y = scene.design.outline.bounds
    shapes = [
        (scene.design.outline, "#e9edf1"), (stays, _STAYS), (level.gone, _GONE),
        (level.excess.pieces, _LEFT), (level.excess.unexplained, _EXCESS),
        (shapely.intersection(level.gone, stays), _GOUGE),
    ]  # fmt: skip
    body = "\n".join(
        f'<path d="{format_path(shape)}" fill="{colour}" fill-rule="evenodd"/>'
        for shape, colour in shapes
        if not shape.is_empty
    )
    worst = max(proof.gouges, key=lambda fault: fault.mm, default=None)
    size = f'width="{(high_x - low_x) * _SCALE:.0f}" height="{(high_y - low_y) * _SCALE:.0f}"'
    box = f"{low_x:.1f} {-high_y:.1f} {high_x - low_x:.1f} {high_y - low_y:.1f}"
    gouge_label = draw_label(worst) if worst else ""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{box}">'
    return f"{head}\n{body}\n{gouge_label}</svg>\n"


def draw_label(fault: Fault) -> str:
    """The SVG text of a gouge: its line and its depth in mm."""
    position = f'x="{fault.x + 4:.2f}" y="{8 - fault.y:.2f}"'
    words = f"line {fault.line}: {fault.mm:.2f} mm into the part"
    return (
        f'<text {position} font-size="2" font-family="sans-serif" fill="{_GOUGE}">{words}</text>\n'
    )


def main(folder: Path) -> None:
    scene = next(candidate for candidate in make_scenes() if candidate.tabs)
    body = damage_body(scene, 0.7)
    proof = prove([replace(scene.cuts[0], body=body, lines=range(1, len(body) + 1))], scene.design)
    (folder / "stock.svg").write_text(draw(scene, proof))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
