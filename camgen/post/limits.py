"""The limits of the comparison: how coarse a text may be.

A text is as exact as its last printed digit, and `Post.tolerance` says how exact that is. Two
limits hold for it:

* In mm, what the job allows: `tolerance.chord`, the deviation of lines and arcs from the drawn
  curve. The settings `arc_fit`, `simplify` and `corner` do not count. They say how far a shape may
  be changed on purpose, 0 switches the change off, and no point of the plan moves by them
  after the plan is made. So they say nothing about the rounding of a printed point.
* In every other unit a fixed bound, `BOUNDS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from msgspec.structs import asdict, replace

from camgen.model.errors import JobError
from camgen.model.text import short
from camgen.post import Tolerance

#: The largest tolerance that a post may have, by field of `Tolerance`. No job loosens them.
BOUNDS: Mapping[str, float] = {
    # rad. A point 100 mm from the TCP moves by 0.009 mm, less than the default of tolerance.chord.
    "angle": math.radians(0.005),
    # rad or mm. The TCP of an arm of 1 m moves by 0.017 mm.
    "joint": math.radians(0.001),
    # mm/s. 1 % of 10 mm/s, a slow feed.
    "speed": 0.1,
    # N. 1 % of 10 N, a light force.
    "force": 0.1,
    # s. Controllers execute an instruction in about 10 ms.
    "seconds": 0.01,
    # rad/s. 1 % of 6 deg/s, a slow reorientation.
    "turn": 1e-3,
    # Fraction of the maximum joint speeds: a tenth of the least step of a speed override, 1 %.
    "share": 1e-3,
    # rad/s. 1 % of 6 deg/s, a slow joint.
    "rate": 1e-3,
}
#: A post may add the rounding of its own arithmetic to half a digit, up to 1 %.
_ARITHMETIC = 1.01


def limit_tolerance(tolerance: Tolerance, chord: float) -> Tolerance:
    """Gives the tolerance of the comparison: in mm the smaller of the post's and the job's.

    chord: `tolerance.chord` of the job, mm.

    Raises JobError for a text that would be coarser than the job allows.
    """
    if tolerance.mm > chord * _ARITHMETIC:
        digit = short(tolerance.mm, 6)
        raise JobError(
            "[post] decimals",
            f"coordinates are printed to {digit} mm, but tolerance.chord = {short(chord, 6)}",
            remedy=f"raise post.decimals, or set tolerance.chord = {digit}",
        )
    return replace(tolerance, mm=min(tolerance.mm, chord))


def find_loose(tolerance: Tolerance) -> str:
    """Names a number of a tolerance that is not possible, and the reason; empty if all are."""
    for name, value in asdict(tolerance).items():
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            return f"{name} = {value!r} is not a number"
        if not math.isfinite(value):
            return f"{name} = {value:g} is not finite"
        if value < 0 or (value == 0 and name != "share"):
            return f"{name} = {value:g} is not above 0"
        if value > BOUNDS.get(name, math.inf):
            return f"{name} = {value:g} is more than {BOUNDS[name]:g}"
    return ""
