"""Samples of the edges of a part, and the orientations in which the tool has room there.

Whether tool and holder meet the part or a fixture does not depend on the arm: it is tested once
for all places.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes, meet
from camgen.collision.cell import CellScene, make_cell_scene
from camgen.collision.mesh import find_struck
from camgen.model.job import Job
from camgen.model.part import BoolArray, IntArray, Solid
from camgen.model.pose import FloatArray, Pose
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.reach import widest_grid
from camgen.motion.rolls import find_freedom
from camgen.robots.workcell import Workcell

#: mm, rad: distance of the samples of an edge.
_SAMPLE_MM, _SAMPLE_TURN = 40.0, math.radians(45)
#: Orientations of each sample that are kept.
_CHOICES = 4


class Samples(Struct, frozen=True, eq=False):
    """N samples of E edges with M orientations, M >= N.

    position: (N, 3) of the TCP, work frame, mm.
    weights: (N, E) share of an edge that a sample stands for.
    owner: (M,) sample of each orientation, in order. A sample without an orientation has none.
    rotation: (M, 3, 3) work_from_tool. The first one of a sample is the nearest to the nominal one,
        the others are far from those before them.
    """

    position: FloatArray
    weights: FloatArray
    owner: IntArray
    rotation: FloatArray

    @property
    def starts(self) -> IntArray:
        """The first orientation of each sample that has any."""
        return np.flatnonzero(np.diff(self.owner, prepend=-1))

    def sum_by_edge(self, is_reached: BoolArray) -> FloatArray:
        """Share of each edge (S, E).

        is_reached: (S, N) by sample, or by those samples that have an orientation.
        """
        weights = self.weights
        if is_reached.shape[1] != len(weights):
            weights = weights[self.owner[self.starts]]
        return np.asarray(is_reached @ weights)

    def thin_out(self, samples: int, choices: int) -> Samples:
        """An even choice of samples and the first orientations of each.

        samples: number of samples, about.
        choices: number of orientations of a sample, at most.
        """
        step = max(1, math.ceil(len(self.position) / samples))
        kept = np.arange(len(self.position)) % step == 0
        rank = np.arange(len(self.owner)) - np.searchsorted(self.owner, self.owner)
        chosen = kept[self.owner] & (rank < choices)
        number = np.cumsum(kept) - 1
        weights = self.weights[kept] * step
        return Samples(
            self.position[kept], weights, number[self.owner[chosen]], self.rotation[chosen]
        )


def make_samples(
    job: Job, cell: Workcell, solid: Solid, tip: float, paths: Mapping[str, PosePath]
) -> Samples:
    """Samples along the pose paths of edges.

    cell: the cell of the stand; where the part is before the arm does not matter.
    tip: mm that the edges may enter the tool.
    """
    freedom = find_freedom(job)
    around_part = make_cell_scene(job, cell, solid, tip)
    position, owner, rotation, weights = [], [], [], []
    count = 0
    for number, path in enumerate(paths.values()):
        samples = divide(path, count_parts(path, _SAMPLE_MM, _SAMPLE_TURN))
        grid = widest_grid(freedom, path)
        turned = samples.rotation[:, None] @ grid.nominal_from_tool
        has_room = _find_room(around_part, cell, samples.position, turned)
        row, choice = _choose(has_room, grid.cost, grid.nominal_from_tool)
        lengths = samples.length
        share = np.zeros((len(samples), len(paths)))
        share[:-1, number] += lengths / 2
        share[1:, number] += lengths / 2
        weights.append(share / max(float(lengths.sum()), 1e-9))
        position.append(samples.position)
        owner.append(row + count)
        rotation.append(turned[row, choice])
        count += len(samples)
    if not position:
        none = np.zeros(0, dtype=np.int64)
        return Samples(np.zeros((0, 3)), np.zeros((0, 0)), none, np.zeros((0, 3, 3)))
    return Samples(
        np.concatenate(position),
        np.concatenate(weights),
        np.concatenate(owner),
        np.concatenate(rotation),
    )


def _choose(
    has_room: BoolArray, cost: FloatArray, orientations: FloatArray
) -> tuple[IntArray, IntArray]:
    """Sample and orientation of at most `_CHOICES` per sample: the cheapest, then distant ones.

    has_room: (N, C).
    cost: (C,) of each orientation.
    orientations: (C, 3, 3).
    """
    traces = np.einsum("aij,bij->ab", orientations, orientations)
    distance = np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)).round(6)
    chosen = np.where(has_room, cost, math.inf).argmin(axis=1)
    distance_to_kept = np.where(has_room, distance[chosen], -1.0)
    kept = [np.where(has_room.any(axis=1), chosen, -1)]
    for _ in range(_CHOICES - 1):
        following = distance_to_kept.argmax(axis=1)
        is_new = distance_to_kept.max(axis=1) > 0
        kept.append(np.where(is_new, following, -1))
        distance_to_kept = np.minimum(
            distance_to_kept, np.where(has_room, distance[following], -1.0)
        )
    table = np.stack(kept, axis=1)
    row, column = np.nonzero(table >= 0)
    return row, table[row, column]


def _find_room(
    scene: CellScene, cell: Workcell, position: FloatArray, rotation: FloatArray
) -> BoolArray:
    """Which orientations (N, C) leave tool and holder clear of the part and of the fixtures.

    position: (N, 3) of the TCP.
    rotation: (N, C, 3, 3) work_from_tool.
    """
    shape = rotation.shape[:2]
    turned = rotation.reshape(-1, 3, 3)
    origin = np.repeat(position, shape[1], axis=0)
    robot = scene.scene.robot
    tool_from_flange = cell.flange_from_tool.inverse() @ robot.flange.inverse()
    work_from_base = cell.base_from_work.inverse()
    is_free = np.ones(len(turned), dtype=np.bool_)
    last = len(robot.joints)
    for target in scene.scene.targets:
        work_from_mesh = work_from_base @ target.base_from_mesh
        for box in target.striking[scene.scene.frame[target.striking] == last].tolist():
            pose = Pose(scene.scene.rotation[box], tuple(scene.scene.origin[box].tolist()))
            boxes = _place(tool_from_flange @ pose, scene.scene.half[box], origin, turned)
            left = np.flatnonzero(is_free)
            seen = boxes[left].seen_from(work_from_mesh.rotation, np.asarray(work_from_mesh.origin))
            is_free[left] = ~find_struck(target.mesh, seen)
    obstacles = list(chain.from_iterable(link.boxes for link in scene.standing))
    for body in scene.bodies:
        for box in body.boxes:
            pose = cell.flange_from_tool.inverse() @ box.link_from_box
            boxes = _place(pose, np.asarray(box.half), origin, turned)
            for obstacle in obstacles:
                place = work_from_base @ obstacle.link_from_box
                left = np.flatnonzero(is_free)
                fixed = Boxes(
                    np.broadcast_to(place.origin, (len(left), 3)),
                    np.broadcast_to(place.rotation, (len(left), 3, 3)),
                    np.broadcast_to(obstacle.half, (len(left), 3)),
                )
                is_free[left] = ~meet(boxes[left], fixed)
    return is_free.reshape(shape)


def _place(
    tool_from_box: Pose, half: FloatArray, origin: FloatArray, rotation: FloatArray
) -> Boxes:
    """A box of the tool at poses of the TCP (N, 3) and (N, 3, 3), work frame."""
    return Boxes(
        origin + rotation @ np.asarray(tool_from_box.origin),
        rotation @ tool_from_box.rotation,
        np.broadcast_to(half, (len(origin), 3)),
    )
