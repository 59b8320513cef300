"""Simulated scans of parts with known truth, for the tests and for bench/read/localize.py.

Nothing here is camgen's own.
"""

import numpy as np
import trimesh

#: Four looks from above and aside, so that all walls are seen; and one look.
ROUND = np.array([[0.6, 0.5, 0.9], [-0.6, 0.5, 0.9], [-0.6, -0.5, 0.9], [0.6, -0.5, 0.9]])
ASIDE = np.array([[0.4, 0.35, 0.85]])
DOWN = np.array([[0.0, 0.0, 1.0]])


def surface(corners, count, rng):
    """Random points (count, 3) of triangles (F, 3, 3) by area, and the outward normal of each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    cross = np.cross(b - a, c - a)
    areas = np.linalg.norm(cross, axis=1)
    which = rng.choice(len(corners), count, p=areas / areas.sum())
    s, t = rng.random((2, count))
    root = np.sqrt(s)
    points = (
        (1 - root)[:, None] * a[which]
        + (root * (1 - t))[:, None] * b[which]
        + (root * t)[:, None] * c[which]
    )
    return points, cross[which] / areas[which, None]


def unhidden(points, normals, view, pixel=1.0):
    """Which points a far scanner in the direction ``view`` sees: those in front in their pixel of a depth picture."""
    z = view / np.linalg.norm(view)
    x = np.cross(z, [0.36, 0.48, -0.8])
    x /= np.linalg.norm(x)
    at = np.floor(points @ np.column_stack([x, np.cross(z, x)]) / pixel).astype(int)
    at -= at.min(axis=0)
    key, depth = at[:, 0] * (at[:, 1].max() + 1) + at[:, 1], points @ z
    front = np.full(key.max() + 1, -np.inf)
    np.maximum.at(front, key, depth)
    steep = normals @ z
    return (steep > 0.15) & (depth > front[key] - 2 * pixel / np.maximum(steep, 0.15))


def bench(low, high, count, rng):
    """Points (count, 3) of the table under and around a part's box, but not within its outline."""
    middle, half = (low + high)[:2] / 2, (high - low)[:2] / 2
    at = rng.uniform(-1.1, 1.1, (20 * count, 2)) * 2 * half
    at = at[(np.abs(at) > half).any(axis=1)][:count]
    return np.column_stack([at + middle, np.full(len(at), low[2])])


def scan(mesh, count, seed, views=None, noise=0.1, table=0.0):
    """``count`` points of ``mesh`` in its own frame: of all of it or of what is seen from ``views``, with normal noise
    (mm) in all directions; a share ``table`` of them lies on the bench.
    """
    rng = np.random.default_rng(seed)
    corners = mesh.triangles
    tabled = round(table * count)
    points, normals = surface(corners, count if views is None else 6 * count, rng)
    if views is not None:
        points = points[np.logical_or.reduce([unhidden(points, normals, view) for view in views])]
    points = points[: count - tabled]
    assert len(points) == count - tabled
    if tabled:
        points = np.vstack([points, bench(*mesh.bounds, tabled, rng)])
    return points + rng.normal(0, noise, points.shape)


def placed(rng, degrees, mm):
    """A random rotation of at most ``degrees`` (by angle) and a random shift of at most ``mm`` in each coordinate."""
    axis = rng.normal(size=3)
    turn = trimesh.transformations.rotation_matrix(np.radians(rng.uniform(0, degrees)), axis)[
        :3, :3
    ]
    return turn, rng.uniform(-mm, mm, 3)


def errors(found, truth, vertices):
    """Of a found (rotation, origin) against the true one: mm at the origin, mm at the worst vertex, deg."""
    (r, o), (s, p) = found, truth
    off = np.linalg.norm((vertices @ r.T + o) - (vertices @ s.T + p), axis=1).max()
    # The chord between the two rotations: exact for small angles, where an arc cosine has no digits left.
    angle = 2 * np.degrees(np.arcsin(min(1.0, np.linalg.norm(r - s) / np.sqrt(8))))
    return float(np.linalg.norm(o - p)), float(off), float(angle)
