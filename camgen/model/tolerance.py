"""Tolerances and numbers that mean the same wherever they stand, each with its unit and its reason.

What means something of its own has a name of its own where it is used.
"""

#: Nearer than this, mm, two points, two heights or two ends are one: no controller prints a shorter piece, and doubles
#: are a thousand times finer up to a kilometre.
SAME_POINT_MM = 1e-6
#: Keeps values with few decimals, the usual ones, away from the border between two cells of a grid, in cells.
OFF_GRID = 0.381966
#: Keeps a division by a length or a square of nothing finite; below it no number has digits left.
NONZERO = 1e-300
#: Added to cosines between the edges of two cuboids: parallel edges have no cross product, and must not seem to part
#: what meets.
PARALLEL_EDGES = 1e-9
#: Above where a peck ended the feed begins again, mm: 0.01 inch, where the cycle G83 of LinuxCNC begins it.
PECK_CLEARANCE_MM = 0.254
#: From the median of absolute values to the standard deviation of normal noise.
SIGMAS_OF_MEDIAN = 1.4826
#: Distances, mm, from a corner at which its rounding may begin, largest first. Every controller has
#: them: RAPID as z5, z1 and z0 (ABB, zonedata), the others as any number. 0 is an exact stop.
ZONES = (5.0, 1.0, 0.3)
#: mm: smallest distance before a corner at which its rounding begins. Only motions beside an arc
#: of a small radius have it; RAPID declares it as a zone.
SMALLEST_ZONE = 0.1
#: Distance from a contour, beyond the tool's radius, at which the tool returns beside it, mm: a
#: burr that still stands there is 3 mm high at most, see `camgen.check.photo.kinds`.
BESIDE_WORKED_MM = 3.0
