"""Draws parts, tours and results in a notebook, seen from above and to scale."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from camgen.geometry.ragged import compute_first_rows
from camgen.model.drawing import draw_svg
from camgen.model.part import Line, Part
from camgen.model.path import Tour
from camgen.preview.curves import trace_spans
from camgen.preview.draw import (
    PageChains,
    Paper,
    choose_colour,
    format_path_data,
    make_contour_chains,
    make_line_chains,
    make_path_chains,
    measure_bounds,
)

#: Maximum width and height of the picture, and the margin around its content, px.
_SIZE, _MARGIN = 480.0, 12.0
_PART = "#80868b"


@draw_svg.register
def _draw_part(part: Part) -> str:
    """Contours, or edges and curves, from above."""
    return _draw([(chains, [_PART] * len(chains.first)) for chains in _make_chains(part)])


@draw_svg.register
def _draw_tour(tour: Tour) -> str:
    """Paths in the colours of their order, and the links between them."""
    count = len(tour.paths)
    ends = [np.stack([a.position[-1, :2], b.position[0, :2]]) for a, b in pairwise(tour.paths)]
    links = make_line_chains(ends)
    colours = [choose_colour(k, count) for k in range(count)]
    return _draw([(links, ["#dadce0"] * len(ends)), (make_path_chains(tour.paths), colours)])


def _make_chains(part: Part) -> list[PageChains]:
    lines: Sequence[Line] = part.curves or (part.solid.edges if part.solid else ())
    if part.contours and not lines:
        return [make_contour_chains(part.contours)]
    if not lines:
        return []
    size = float(np.linalg.norm(np.ptp(np.concatenate([line.points for line in lines]), axis=0)))
    spans = trace_spans([(line.points, line.via) for line in lines], 1e-3 * size)
    if not len(spans.points):
        return []
    first = compute_first_rows(spans.counts)
    return [PageChains(spans.points[:, :2], np.zeros(len(spans.points)), first)]


def _draw(groups: Sequence[tuple[PageChains, Sequence[str]]]) -> str:
    """Chains, each in its colour, as one picture."""
    low, high = measure_bounds([chains for chains, _ in groups])
    size = np.maximum(high - low, 1e-6)
    scale = (_SIZE - 2 * _MARGIN) / float(size.max())
    width, height = (size * scale + 2 * _MARGIN).tolist()
    page = Paper(scale, _MARGIN - float(low[0]) * scale, _MARGIN + float(high[1]) * scale)
    lines = []
    for chains, colours in groups:
        for data, colour in zip(format_path_data(chains, page), colours, strict=True):
            lines.append(f'<path d="{data}" stroke="{colour}"/>')
    box = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.2f} {height:.2f}"'
    style = 'fill="none" stroke-width="1.2" stroke-linejoin="round"'
    start = f'<svg xmlns="http://www.w3.org/2000/svg" {box}><g {style}>'
    return f"{start}{''.join(lines)}</g></svg>"
