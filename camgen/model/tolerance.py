"""Tolerances and numbers that mean the same wherever they are used, each with its unit and reason.

A number with a meaning of its own has a name where it is used.
"""

#: mm: two points, two heights or two ends that are nearer are equal. No controller prints a shorter
#: piece, and doubles are a thousand times finer up to a kilometre.
SAME_POINT_MM = 1e-6
#: Fraction of a cell by which a grid is shifted, so that usual values, which have few decimals, are
#: not on the border between two cells.
OFF_GRID = 0.381966
#: Lower bound of a divisor that is a length or a square. Below it no number has digits left.
NONZERO = 1e-300
#: Added to cosines between the edges of two cuboids. Parallel edges have no cross product, which
#: would seem to separate cuboids that meet.
PARALLEL_EDGES = 1e-9
#: mm: height above the end of a peck at which the feed begins again: 0.01 inch, as in the cycle G83
#: of LinuxCNC.
PECK_CLEARANCE_MM = 0.254
#: Factor from the median of absolute values to the standard deviation of normal noise.
SIGMAS_OF_MEDIAN = 1.4826
#: mm: distances from a corner at which its rounding may begin, largest first. Every controller has
#: them: RAPID as z5, z1 and z0 (ABB, zonedata), the others as any number. 0 is an exact stop.
ZONES = (5.0, 1.0, 0.3)
#: mm: smallest distance before a corner at which its rounding begins. Only motions next to an arc
#: of a small radius have it; RAPID declares it as a zone.
SMALLEST_ZONE = 0.1
#: mm: distance from a contour, beyond the radius of the tool, at which the tool returns next to it:
#: a burr that is left there is 3 mm high at most, see `camgen.check.photo.kinds`.
BESIDE_WORKED_MM = 3.0
