"""The situations of the photos with deviations, which can contradict their truth."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from bench.photo.deviations import SITUATIONS, situation
from bench.render.conditions import material

#: Situations in which the whole part is another one.
WHOLE = ("larger", "another part")


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("name", SITUATIONS)
def test_a_situation_differs_from_its_drawing_where_its_truth_says(name: str, number: int) -> None:
    drawn, (loops, truth) = situation(name, number)
    differences = shapely.get_parts(shapely.symmetric_difference(material(drawn), material(loops)))
    differences = differences[shapely.area(differences) > 0.01]
    assert bool(len(differences)) == bool(truth) == (name != "clean")
    if name in WHOLE:
        assert [deviation.reach for deviation in truth] == [np.inf]
        return
    points = [shapely.Point(each.place.real, each.place.imag) for each in truth]
    gaps = shapely.distance(differences[:, None], np.array(points, object))
    assert len(differences) == len(truth)
    assert (gaps.min(axis=0, initial=np.inf) <= [each.reach for each in truth]).all()
    assert (gaps.min(axis=1, initial=np.inf) < 0.5).all()
