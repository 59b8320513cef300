"""The checks of the set-up on real drawings: python -m bench.check.set_up [FOLDER]

The drawings and the jobs are chosen by a rule that was written down before the checks:

- `DRAWINGS` are all drawings of the shared data for which `camgen init --operations` proposes a
  job.
- The job of a drawing is that proposal, once as it is, and once for each of aluminium and plywood.
- A line of the checks is false if a reader of the G-code that shares no code with camgen finds
  that the program keeps the limit which the line states.

At most one false line is allowed for ten drawings.
"""

from __future__ import annotations

#: Drawings below the folder `dxf` of the shared data.
DRAWINGS = (
    "SofleKeyboard/OLED_Cover.dxf",
    "SofleKeyboard/SofleKeyboardTopPlate_ShapeOnly.dxf",
    "SofleKeyboard/sofle_pico_key_plate_v3.5.5.dxf",
    "cad-viewer/block-color.dxf",
    "cadquery/1001.dxf",
    "cadquery/MC 12x31.dxf",
    "cadquery/gear.dxf",
    "cadquery/genshi.dxf",
    "cadquery/three_layers.dxf",
    "dxf/arrayed-holes.dxf",
    "dxf/issue27c.dxf",
    "dxf/issue39.dxf",
    "dxf/issue42.dxf",
    "dxf/squircle2.dxf",
    "dxf/testModelPaperSpace.dxf",
    "dxf-parser/polylines.dxf",
    "ezdxf/1_polylines.dxf",
    "ezdxf/2_polylines.dxf",
    "ezdxf/5_us_states.dxf",
    "ezdxf/AC1003_LINE_Example.dxf",
    "ezdxf/R12_with_trash_beyond_EOF.dxf",
    "ezdxf/dimension_in_nested_blocks.dxf",
    "ezdxf/duplicate_handles.dxf",
    "ezdxf/empty_handles.dxf",
    "ezdxf/forms.dxf",
    "ezdxf/hatches_2.dxf",
    "ezdxf/issue_1359_1.dxf",
    "ezdxf/recover02.dxf",
    "ezdxf/uncommon.dxf",
    "ezdxf/wipeout_door.dxf",
    "redox-keyboard/redox_rev1-brd.dxf",
    "trimesh/1002_tray_bottom.DXF",
    "trimesh/125_cycloidal.DXF",
    "trimesh/ChuteHolderPrint.DXF",
    "trimesh/LM2.dxf",
    "trimesh/apu-mount.DXF",
    "trimesh/insert.dxf",
    "trimesh/sliding-base.dxf",
    "trimesh/spline.DXF",
    "trimesh/uc.r12a.dxf",
    "trimesh/uc.r12b.dxf",
    "trimesh/uc.r14a.dxf",
    "trimesh/uc.r14b.dxf",
    "trimesh/uc.r2000b.dxf",
    "trimesh/uc.r2013a.dxf",
    "trimesh/uc.r2013b.dxf",
)
