"""A tool that is pressed against an edge by an admittance controller: the force that an error of the path causes.

One dimension, square to the edge. The controller moves the tool by a beyond the planned path,

    m a'' + b a' = F0 - F,    F = max(k (a + e), 0),    1 / k = 1 / k_tool + 1 / k_arm,

where e is how much nearer to the part the path is than it should be, and F0 the force that is asked for. In the paper
(section 4.4.2) F0 is 2 N. It says nothing of m, b and k; those below are assumed: a soft flap wheel on an arm of the
size, and a controller that settles within a tenth of a second. Force that is not asked for (F0 = 0) is let go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Contact:
    """Stiffness of tool and arm, N/mm; virtual mass, N s2/mm, and damping, N s/mm; cut-off of what is shown, Hz."""

    tool: float = 4.0
    arm: float = 40.0
    mass: float = 0.002
    damping: float = 0.2
    shown: float = 5.0

    @property
    def stiffness(self) -> float:
        """Of both in series, N/mm."""
        return 1 / (1 / self.tool + 1 / self.arm)


#: s between the steps of the simulation.
STEP = 0.001


def pressed(
    error: np.ndarray, asked: np.ndarray, time: np.ndarray, model: Contact
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) N and mm: the force at the places of a program, low-passed as in the paper, and the way beyond its path.

    error: (N,) mm, how much nearer to the part than it should be the path is. asked: (N,) N. time: (N,) s from each
    place to the next.
    """
    at = np.append(0.0, np.cumsum(time[:-1]))
    ticks = np.arange(0.0, at[-1] + STEP, STEP)
    off = np.interp(ticks, at, error).tolist()
    wanted = asked[np.clip(np.searchsorted(at, ticks, side="right") - 1, 0, len(at) - 1)].tolist()
    k, share = model.stiffness, 1 - np.exp(-2 * np.pi * model.shown * STEP)
    beyond, speed, force, shown = 0.0, 0.0, np.empty(len(ticks)), 0.0
    moved = np.empty(len(ticks))
    for j, (e, f0) in enumerate(zip(off, wanted, strict=True)):
        now = max(k * (beyond + e), 0.0)
        speed += (f0 - now - model.damping * speed) / model.mass * STEP
        beyond += speed * STEP
        shown += share * (now - shown)
        force[j], moved[j] = shown, beyond
    return np.interp(at, ticks, force), np.interp(at, ticks, moved)
