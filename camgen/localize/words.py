"""Poses and patches in words, for the summary, the job file and the refusals of `localize`."""

from __future__ import annotations

import math

from camgen.localize.verdict import Patch
from camgen.model.pose import Pose, compute_fixed_xyz
from camgen.model.text import fixed, short

#: Digits of x, y, z, mm, and of rx, ry, rz, deg.
_DIGITS = (4, 4, 4, 5, 5, 5)


def format_values(pose: Pose) -> str:
    """A pose as the list of a job file: x, y, z in mm, then rx, ry, rz in degrees."""
    angles = map(math.degrees, compute_fixed_xyz(pose.rotation))
    return f"[{', '.join(map(fixed, (*pose.origin, *angles), _DIGITS))}]"


def describe_patch(patch: Patch) -> str:
    """The difference at a patch, with its place in the model's frame and its size."""
    place = ", ".join(short(value, 1) for value in patch.middle.tolist())
    length, width = short(patch.size[0], 0), short(patch.size[1], 0)
    if patch.beyond:
        return f"the scan runs on beyond a rim at {place} of the model over {length} mm"
    if patch.size[1] < 1:
        return f"along a rim at {place} of the model {length} mm of surface are missing"
    return f"at {place} of the model {length} x {width} mm of surface are missing"
