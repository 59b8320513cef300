"""Simulated scans of parts with known truth, for the tests and for bench/read/localize.py.

Nothing here is camgen's own.
"""

import numpy as np
import trimesh

#: Directions to the scanner: four around the part, which see all walls, one from the side, and one
#: from above.
ROUND = np.array([[0.6, 0.5, 0.9], [-0.6, 0.5, 0.9], [-0.6, -0.5, 0.9], [0.6, -0.5, 0.9]])
ASIDE = np.array([[0.4, 0.35, 0.85]])
DOWN = np.array([[0.0, 0.0, 1.0]])


def surface(corners, count, rng):
    """Random points (count, 3) on triangles (F, 3, 3) by area, and the outward normal of each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    cross = np.cross(b - a, c - a)
    areas = np.linalg.norm(cross, axis=1)
    triangle = rng.choice(len(corners), count, p=areas / areas.sum())
    s, t = rng.random((2, count))
    root = np.sqrt(s)
    points = (
        (1 - root)[:, None] * a[triangle]
        + (root * (1 - t))[:, None] * b[triangle]
        + (root * t)[:, None] * c[triangle]
    )
    return points, cross[triangle] / areas[triangle, None]


def unhidden(points, normals, view, pixel=1.0):
    """Mask of the points that a distant scanner in the direction `view` sees.

    These are the nearest points in each pixel of a depth picture. pixel: mm.
    """
    z = view / np.linalg.norm(view)
    x = np.cross(z, [0.36, 0.48, -0.8])
    x /= np.linalg.norm(x)
    cells = np.floor(points @ np.column_stack([x, np.cross(z, x)]) / pixel).astype(int)
    cells -= cells.min(axis=0)
    key, depth = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1], points @ z
    front = np.full(key.max() + 1, -np.inf)
    np.maximum.at(front, key, depth)
    steep = normals @ z
    return (steep > 0.15) & (depth > front[key] - 2 * pixel / np.maximum(steep, 0.15))


def bench(low, high, count, rng):
    """Points (count, 3) of the table around the box of a part, outside of its outline."""
    middle, half = (low + high)[:2] / 2, (high - low)[:2] / 2
    positions = rng.uniform(-1.1, 1.1, (20 * count, 2)) * 2 * half
    positions = positions[(np.abs(positions) > half).any(axis=1)][:count]
    return np.column_stack([positions + middle, np.full(len(positions), low[2])])


def scan(mesh, count, seed, views=None, noise=0.1, table=0.0):
    """`count` points of a mesh in its frame, with normal noise (mm) in all directions.

    views: directions from which the points are visible; None samples the whole mesh.
    table: fraction of the points that lies on the bench.
    """
    rng = np.random.default_rng(seed)
    corners = mesh.triangles
    on_table = round(table * count)
    points, normals = surface(corners, count if views is None else 6 * count, rng)
    if views is not None:
        points = points[np.logical_or.reduce([unhidden(points, normals, view) for view in views])]
    points = points[: count - on_table]
    assert len(points) == count - on_table
    if on_table:
        points = np.vstack([points, bench(*mesh.bounds, on_table, rng)])
    return points + rng.normal(0, noise, points.shape)


def placed(rng, degrees, mm):
    """A random rotation (3, 3) and a random shift (3,).

    degrees: largest angle of the rotation.
    mm: largest shift in each coordinate.
    """
    axis = rng.normal(size=3)
    rotation = trimesh.transformations.rotation_matrix(np.radians(rng.uniform(0, degrees)), axis)[
        :3, :3
    ]
    return rotation, rng.uniform(-mm, mm, 3)


def errors(result, truth, vertices):
    """The errors of a pose: mm at the origin, mm at the worst vertex, and deg.

    result, truth: (rotation, origin).
    """
    (r, o), (s, p) = result, truth
    worst = np.linalg.norm((vertices @ r.T + o) - (vertices @ s.T + p), axis=1).max()
    # The angle follows from the chord between both rotations: an arc cosine has no digits left at
    # small angles.
    angle = 2 * np.degrees(np.arcsin(min(1.0, np.linalg.norm(r - s) / np.sqrt(8))))
    return float(np.linalg.norm(o - p)), float(worst), float(angle)
