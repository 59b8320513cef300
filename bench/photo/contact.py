"""Force of a tool that an admittance controller presses against an edge, for a path with errors.

The model has one dimension, normal to the edge. The controller moves the tool by a beyond the path:

    m a'' + b a' = F0 - F,    F = max(k (a + e), 0),    1 / k = 1 / k_tool + 1 / k_arm,

e is the distance by which the path is too near to the part, and F0 the set force: 2 N in the paper
(section 4.4.2). The paper does not state m, b and k. The values here are assumed: a soft flap wheel
on an arm of that size, and a controller that settles within a tenth of a second. Where no force is
set (F0 = 0), the tool yields.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Contact:
    """The constants of the model.

    tool: stiffness of the tool, N/mm.
    arm: stiffness of the arm, N/mm.
    mass: virtual mass, N s2/mm.
    damping: virtual damping, N s/mm.
    cutoff: frequency of the low-pass filter of the result, Hz.
    """

    tool: float = 4.0
    arm: float = 40.0
    mass: float = 0.002
    damping: float = 0.2
    cutoff: float = 5.0

    @property
    def stiffness(self) -> float:
        """Stiffness of tool and arm in series, N/mm."""
        return 1 / (1 / self.tool + 1 / self.arm)


#: Step of the simulation, s.
STEP = 0.001


def simulate_force(
    error: np.ndarray, force: np.ndarray, time: np.ndarray, model: Contact
) -> tuple[np.ndarray, np.ndarray]:
    """The force at the places of a program, low-passed as in the paper, and the motion beyond it.

    error: (N,) mm, distance by which the path is too near to the part.
    force: (N,) N, set force.
    time: (N,) s, from each place to the next.
    Returns (N,) N and (N,) mm.
    """
    at = np.append(0.0, np.cumsum(time[:-1]))
    ticks = np.arange(0.0, at[-1] + STEP, STEP)
    place = np.clip(np.searchsorted(at, ticks, side="right") - 1, 0, len(at) - 1)
    k, share = model.stiffness, 1 - np.exp(-2 * np.pi * model.cutoff * STEP)
    position = speed = filtered = 0.0
    forces, positions = np.empty(len(ticks)), np.empty(len(ticks))
    steps = zip(np.interp(ticks, at, error).tolist(), force[place].tolist(), strict=True)
    for j, (e, f0) in enumerate(steps):
        contact = max(k * (position + e), 0.0)
        speed += (f0 - contact - model.damping * speed) / model.mass * STEP
        position += speed * STEP
        filtered += share * (contact - filtered)
        forces[j], positions[j] = filtered, position
    return np.interp(at, ticks, forces), np.interp(at, ticks, positions)
