"""Faults seeded in set-ups, and whether camgen reports them.

python -m bench.check.set_up_faults [SEED, 1]

The rule that chooses them was written down before the checks. There are 200 faults of the kinds
`KINDS`. A fault of a job is built, a fault of a text is given to `camgen verify` beside its job
and its part, with the digest of the text made right again.

- in the job: two tools swapped, depth 0.5 mm or more beyond the stock, feed 1.5 times the
  largest of the table, speed twice the largest, another material, an outline with a gap;
- in the text: depth 0.5 mm, feed times 1.5, speed times 2 or at rest or to the left, the number
  of a tool.

The numbers come from a generator with the seed, and the jobs in turn from `CASES`, for LinuxCNC. A
job without a material has that of `MATERIAL`. A fault counts if
it matters: material that must stay is cut, or a stated limit is exceeded, by a judge that shares no
code with the checks. Each must have a line that the sound job or text has not. At most a tenth may
be invisible without a plan; these are listed.
"""

from __future__ import annotations

#: Kinds of faults, with the number of each.
KINDS = {
    "tools swapped in the job": 20,
    "depth in the job": 20,
    "feed in the job": 20,
    "speed in the job": 20,
    "material in the job": 10,
    "outline with a gap": 10,
    "depth in the text": 20,
    "feed in the text": 20,
    "speed in the text": 20,
    "spindle in the text": 20,
    "tool number in the text": 20,
}

#: Golden jobs that cut material below the top face.
CASES = (
    "bracket-bore",
    "bracket-pocket",
    "bracket-tabs",
    "motor-plate",
    "plate-drill",
    "smooth-passes",
)
MATERIAL = "aluminium"
