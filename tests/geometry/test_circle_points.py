"""Points of a circle in space from their angles, and back."""

import math

import numpy as np
import pytest

from camgen.geometry.arcs import find_circle


def test_points_at_angles_lie_on_the_circle_at_these_angles() -> None:
    """Three points of a circle of 5 mm about (1, 2, 3) in the plane y = 2, running from z to x."""
    centre = np.array([1.0, 2.0, 3.0])
    points = centre + 5.0 * np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    circle = find_circle(*points)
    assert circle is not None
    angles = np.array([0.0, math.pi / 2, math.pi, 1.5 * math.pi])
    expected = np.vstack([points, centre - [5.0, 0.0, 0.0]])
    assert circle.at(angles) == pytest.approx(expected)
    assert circle.angles(expected) == pytest.approx(angles)
    assert circle.distances(circle.at(angles)) == pytest.approx(np.zeros(4), abs=1e-12)
