"""How parts, tours and results draw themselves in a notebook: seen from above, to scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.drawing import draw_svg
from camgen.model.part import Line, Part
from camgen.model.path import Tour
from camgen.preview.curves import of_spans
from camgen.preview.draw import (
    PageChains,
    Paper,
    bounds,
    by_order,
    of_contours,
    of_paths,
    path_data,
)

#: The picture is made as large as fits in here, px, with a margin around it.
_SIZE, _MARGIN = 480.0, 12.0
_PART = "#80868b"


@draw_svg.register
def _draw_part(part: Part) -> str:
    """Contours, or edges and curves from above."""
    return _draw([(chains, [_PART] * len(chains.first)) for chains in _chains(part)])


@draw_svg.register
def _draw_tour(tour: Tour) -> str:
    """Paths in the colours of their order, and the ways between them."""
    count = len(tour.paths)
    if not count:
        return _draw([])
    ends = [
        np.stack([a.position[-1, :2], b.position[0, :2]])
        for a, b in zip(tour.paths, tour.paths[1:], strict=False)
    ]
    ways = (
        PageChains(
            np.concatenate(ends),
            np.zeros(2 * len(ends)),
            np.arange(0, 2 * len(ends), 2, dtype=np.int64),
        )
        if ends
        else None
    )
    travel = [(ways, ["#dadce0"] * len(ends))] if ways else []
    return _draw([*travel, (of_paths(tour.paths), [by_order(k, count) for k in range(count)])])


def _chains(part: Part) -> list[PageChains]:
    lines: Sequence[Line] = part.curves or (part.solid.edges if part.solid else ())
    if not lines:
        return [of_contours(part.contours)] if part.contours else []
    size = float(np.linalg.norm(np.ptp(np.concatenate([line.points for line in lines]), axis=0)))
    spans = of_spans([(line.points, line.via) for line in lines], 1e-3 * size)
    first = np.cumsum([0, *spans.counts[:-1].tolist()])
    return (
        [PageChains(spans.points[:, :2], np.zeros(len(spans.points)), first)]
        if len(spans.points)
        else []
    )


def _draw(groups: Sequence[tuple[PageChains, Sequence[str]]]) -> str:
    """Chains, each in its colour, as one picture."""
    low, high = bounds([chains for chains, _ in groups])
    wide, tall = (max(float(v), 1e-6) for v in high - low)
    scale = (_SIZE - 2 * _MARGIN) / max(wide, tall)
    width, height = wide * scale + 2 * _MARGIN, tall * scale + 2 * _MARGIN
    page = Paper(scale, _MARGIN - float(low[0]) * scale, _MARGIN + float(high[1]) * scale)
    lines = [
        f'<path d="{data}" stroke="{colour}"/>'
        for chains, colours in groups
        for data, colour in zip(path_data(chains, page), colours, strict=True)
    ]
    box = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.2f} {height:.2f}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {box}><g fill="none" stroke-width="1.2" stroke-linejoin="round">'
        f"{''.join(lines)}</g></svg>"
    )
