"""The picture of docs/stock.md, into docs/images or the folder named.

python -m docs.make.stock_picture [FOLDER]
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

#: Pixels of a mm; colours of what stays, what is gone, inner corners and tabs, other excess, gouges.
_SCALE = 9.0
_STAYS, _GONE, _LEFT, _EXCESS, _GOUGE = "#c9d3dd", "#ffffff", "#f3c56b", "#e67e22", "#d62728"


def damaged(scene: Scene, by: float) -> tuple[Instruction, ...]:
    """The body with the last long line of its last pass moved into the part."""
    body = list(scene.cuts[0].body)
    deep = [
        k for k, item in enumerate(body) if isinstance(item, MoveL) and item.target.origin[2] < -3.9
    ]
    for k in deep[-2:]:
        item = body[k]
        assert isinstance(item, MoveL)
        x, y, z = item.target.origin
        body[k] = replace(item, target=Pose(item.target.rotation, (x + by, y, z)))
    return tuple(body)


def path_of(shape: Any) -> str:
    """The rings of polygons as one path of SVG, y up."""
    rings = [
        ring
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    return " ".join(
        "M" + " L".join(f"{x:.3f} {-y:.3f}" for x, y in ring.coords) + " Z" for ring in rings
    )


def draw(scene: Scene, proof: StockProof) -> str:
    """The lowest level: what stays, what is gone, what is left over and what is cut too much."""
    level = proof.levels[-1]
    stays = show_stay(scene.design, -level.bottom)
    low_x, low_y, high_x, high_y = scene.design.outline.bounds
    shapes = [
        (scene.design.outline, "#e9edf1"), (stays, _STAYS), (level.gone, _GONE), (level.excess.pieces, _LEFT),
        (level.excess.unexplained, _EXCESS), (shapely.intersection(level.gone, stays), _GOUGE),
    ]  # fmt: skip
    body = "\n".join(
        f'<path d="{path_of(shape)}" fill="{colour}" fill-rule="evenodd"/>'
        for shape, colour in shapes
    )
    worst = max(proof.gouges, key=lambda fault: fault.mm, default=None)
    size = f'width="{(high_x - low_x) * _SCALE:.0f}" height="{(high_y - low_y) * _SCALE:.0f}"'
    box = f"{low_x:.1f} {-high_y:.1f} {high_x - low_x:.1f} {high_y - low_y:.1f}"
    said = label(worst) if worst else ""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{box}">\n{body}\n{said}</svg>\n'
    )


def label(fault: Fault) -> str:
    """A gouge by line and mm."""
    where = f'x="{fault.x + 4:.2f}" y="{8 - fault.y:.2f}"'
    words = f"line {fault.line}: {fault.mm:.2f} mm into the part"
    return f'<text {where} font-size="2" font-family="sans-serif" fill="{_GOUGE}">{words}</text>\n'


def main(folder: Path) -> None:
    scene = next(one for one in make_scenes() if one.tabs)
    body = damaged(scene, 0.7)
    proof = prove([replace(scene.cuts[0], body=body, lines=range(1, len(body) + 1))], scene.design)
    (folder / "stock.svg").write_text(draw(scene, proof))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
