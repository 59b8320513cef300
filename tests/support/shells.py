"""Sheets and hollow parts without rotational symmetry, and scans of them from one place.

The module is independent of camgen.
"""

import numpy as np
import trimesh

from tests.support.clouds import surface


def blocks(xs, ys, zs, filled):
    """The closed surface of the filled cells between planes at `xs`, `ys` and `zs`.

    filled: whether the cell around a point (x, y, z) is filled.
    """
    planes = [np.asarray(axis, dtype=float) for axis in (xs, ys, zs)]
    counts = [len(axis) - 1 for axis in planes]
    full = np.zeros([n + 2 for n in counts], dtype=bool)
    for cell in np.ndindex(*counts):
        middle = [axis[i] / 2 + axis[i + 1] / 2 for axis, i in zip(planes, cell, strict=True)]
        full[tuple(np.add(cell, 1))] = filled(*middle)
    corners, faces = {}, []
    for cell in np.argwhere(full):
        for axis in range(3):
            for side in (0, 1):
                neighbour = cell.copy()
                neighbour[axis] += 2 * side - 1
                if full[tuple(neighbour)]:
                    continue
                low = cell - 1
                indices = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    corner = low.copy()
                    corner[axis] += side
                    corner[(axis + 1) % 3] += a
                    corner[(axis + 2) % 3] += b
                    indices.append(corners.setdefault(tuple(corner.tolist()), len(corners)))
                indices = indices if side else indices[::-1]
                faces += [
                    [indices[0], indices[1], indices[2]],
                    [indices[0], indices[2], indices[3]],
                ]
    places = np.array(list(corners))
    vertices = np.column_stack([planes[k][places[:, k]] for k in range(3)])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0
    return mesh


def _within(value, low, high):
    return low < value < high


def sheet(thick=1.6):
    """A flat sheet of 120 x 80 mm with a notch at a corner and two windows of different size."""

    def filled(x, y, _):
        hole = (_within(x, 15, 45) and _within(y, 15, 30)) or (
            _within(x, 70, 85) and _within(y, 40, 65)
        )
        return not (hole or (x > 95 and y > 55))

    return blocks((0, 15, 45, 70, 85, 95, 120), (0, 15, 30, 40, 55, 65, 80), (0, thick), filled)


def angle(thick=2.0):
    """A sheet with a bend of 90 deg: a leg of 90 mm with a window, a leg of 50 mm with a notch."""

    def filled(x, y, z):
        foot = z < thick and not (_within(x, 50, 75) and _within(y, 15, 40))
        wall = x < thick and not (z > 35 and y > 50)
        return foot or wall

    return blocks((0, thick, 50, 75, 90), (0, 15, 40, 50, 70), (0, thick, 35, 50), filled)


def step_sheet(thick=1.2):
    """A sheet with two bends: a foot, a wall and a ledge on the other side."""

    def filled(x, y, z):
        foot = z < thick and x < 40 and not (_within(x, 10, 25) and y < 20)
        wall = _within(x, 40 - thick, 40)
        ledge = z > 30 - thick and x > 40 - thick and not (x > 70 and y > 60)
        return foot or wall or ledge

    return blocks(
        (0, 10, 25, 40 - thick, 40, 70, 85), (0, 20, 60, 90), (0, thick, 30 - thick, 30), filled
    )


def tray(wall=3.0):
    """An open box of 110 x 75 x 40 mm with a notch in one wall and a rib inside."""

    def filled(x, y, z):
        floor = z < wall
        side = not (_within(x, wall, 110 - wall) and _within(y, wall, 75 - wall))
        notch = y < wall and _within(x, 20, 45) and z > 25
        rib = _within(x, 70, 70 + wall) and y < 50 and z < 20
        return floor or rib or (side and not notch)

    xs = (0, wall, 20, 45, 70, 70 + wall, 110 - wall, 110)
    return blocks(xs, (0, wall, 50, 75 - wall, 75), (0, wall, 20, 25, 40), filled)


def housing(wall=4.0):
    """A closed box of 100 x 80 x 60 mm with windows in top and side, and with a wall inside."""

    def filled(x, y, z):
        shell = not (
            _within(x, wall, 100 - wall)
            and _within(y, wall, 80 - wall)
            and _within(z, wall, 60 - wall)
        )
        top = z > 60 - wall and _within(x, 15, 70) and _within(y, 15, 65)
        side = x > 100 - wall and _within(y, 20, 45) and _within(z, 15, 45)
        inner = _within(x, 50, 50 + wall) and z < 30
        return (shell and not top and not side) or inner

    xs = (0, wall, 15, 50, 50 + wall, 70, 100 - wall, 100)
    return blocks(
        xs, (0, wall, 15, 20, 45, 65, 80 - wall, 80), (0, wall, 15, 30, 45, 60 - wall, 60), filled
    )


def channel(wall=3.0):
    """A channel of 140 mm, 50 wide and 45 deep, with one leg cut down at an end."""

    def filled(x, y, z):
        leg = (y < wall or y > 50 - wall) and not (y > 25 and x > 90 and z > 20)
        return z < wall or leg

    return blocks((0, 90, 140), (0, wall, 25, 50 - wall, 50), (0, wall, 20, 45), filled)


def comb(wall=3.0):
    """A base with five tall fins of different lengths. A scanner sees little between them."""
    fins = ((0, 70), (14, 60), (28, 70), (42, 50), (56, 40))

    def filled(x, y, z):
        return z < 5 or any(_within(x, at, at + wall) and y < length for at, length in fins)

    starts = [at for at, _ in fins]
    xs = sorted({*starts, *(at + wall for at in starts)})
    return blocks(xs, (0, 40, 50, 60, 70), (0, 5, 45), filled)


def seen_from(corners, points, normals, eye, block_size=200):
    """Mask of the points that a scanner at `eye` sees.

    Their normals face the scanner, and no triangle hides them. Each ray is tested with each
    triangle (F, 3, 3) that faces the scanner: slow, and exact.

    block_size: number of points that are tested together.
    """
    a, b, c = (corners[:, k] for k in range(3))
    facing = ((eye - a) * np.cross(b - a, c - a)).sum(axis=1) > 0
    # A point is hidden if it is within the cone of the eye and a triangle, beyond the plane of the
    # triangle.
    a, b, c = (corner[facing] - eye for corner in (a, b, c))
    sides = [np.cross(b, a), np.cross(c, b), np.cross(a, c)]
    across = np.cross(b - a, c - a)
    distances = (across * a).sum(axis=1)
    rays = points - eye
    is_visible = -(normals * rays).sum(axis=1) / np.linalg.norm(rays, axis=1) > 0.15
    for begin in range(0, len(points), block_size):
        block = rays[begin : begin + block_size].T
        is_hidden = (across @ block) * (1 - 1e-4) < distances[:, None]
        for side in sides:
            is_hidden &= side @ block > 0
        is_visible[begin : begin + block_size] &= ~is_hidden.any(axis=0)
    return is_visible


def one_sided(mesh, count, seed, eye, noise=0.05):
    """`count` points of a mesh in its frame that a scanner at `eye` sees, with normal noise, mm."""
    rng = np.random.default_rng(seed)
    eye = np.asarray(eye, dtype=float)
    points = np.zeros((0, 3))
    for _ in range(30):
        sample, normals = surface(mesh.triangles, 2 * count, rng)
        points = np.vstack([points, sample[seen_from(mesh.triangles, sample, normals, eye)]])
        if len(points) >= count:
            break
    points = points[:count]
    assert len(points) > 200, "a scan from here shows too little of the part"
    return points + rng.normal(0, noise, points.shape)
