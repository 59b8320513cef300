"""A module imports only lower floors (docs/architecture.md)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FLOORS = {
    "errors": 0, "pose": 0, "text": 0, "note": 0, "content": 0,
    "solid": 1, "shapes": 1, "paths": 1, "settings": 1, "geometry": 1, "writing": 1, "tour_start": 1, "tour_seams": 1,
    "instructions": 1, "idle": 2, "artwork": 2, "solids": 1,
    "body": 2, "vision": 2, "robots": 2, "tours": 2, "gcode": 2, "tour_tree": 2,
    "ir_rules": 3, "collision": 3, "edges": 3, "readers": 3, "planners": 3, "tour_search": 3, "lower_rows": 3,
    "ir": 4, "localize": 4, "tour": 4, "leads": 4, "stay_down": 4, "winding": 4,
    "ir_text": 5, "passes": 5, "rfa": 5,
    "post": 6,
    "plugins": 7, "lower": 7, "replay": 7, "check": 7, "surroundings": 7, "testing_cases": 7, "sampling": 7,
    "lower_edges": 8, "testing": 8, "page_fit": 8, "simplify": 8, "cli_job": 8, "report": 8, "reach": 8,
    "preview_draw": 8,
    "finishing": 9, "cycle": 9, "drawn": 9, "schema": 9, "sources": 9, "preview": 9, "preview_panels": 9,
    "cli_say": 9, "cli_plan": 9,
    "collide": 10, "plans": 10, "preview_stages": 10, "preview_drawing": 10,
    "job": 11,
    "page": 12, "cli_summary": 12,
    "cli_build": 13, "cli_init": 13, "cli_inspect": 13, "cli_posts": 13, "cli_verify": 13, "cli_robots": 13,
    "cli_calibrate": 13, "cli_localize": 13, "cli_markers": 13, "cli_schema": 13,
    "cli": 14, "batch": 14,
    "cli_batch": 15, "cli_completion": 15,
    "__main__": 15,
}  # fmt: skip
POST_MAY_IMPORT = {"body", "ir", "pose", "post", "errors", "text", "passes"}
FILES = sorted([*ROOT.glob("camgen/**/*.py"), *ROOT.glob("postprocessors/**/*.py")])


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_down(path: Path) -> None:
    parts = path.relative_to(ROOT).with_suffix("").parts
    rooms = {name.split(".")[1] for name in imported(path) if name.startswith("camgen.")}
    if parts[0] == "postprocessors":
        assert rooms <= POST_MAY_IMPORT | ({"gcode"} if "readback" in parts else set())
        if "readback" in parts:
            assert not any(n.startswith("camgen_posts") and "readback" not in n for n in imported(path))
    elif parts[1] != "__init__":
        own = FLOORS[parts[1]]
        assert not {r for r in rooms if FLOORS[r] > own or (FLOORS[r] == own and r != parts[1] and own > 1)}
