"""Sizes of paper."""

from __future__ import annotations

from camgen.model.errors import JobError
from camgen.model.job import PageTable

#: Width and height upright, mm: ISO 216 and ANSI.
SIZES = {
    "a0": (841.0, 1189.0), "a1": (594.0, 841.0), "a2": (420.0, 594.0), "a3": (297.0, 420.0),
    "a4": (210.0, 297.0), "a5": (148.0, 210.0), "a6": (105.0, 148.0),
    "letter": (215.9, 279.4), "legal": (215.9, 355.6), "tabloid": (279.4, 431.8),
}  # fmt: skip


def compute_page_size(page: PageTable) -> tuple[float, float]:
    """Width and height of the page, mm. JobError if it is not known or not a size."""
    if isinstance(page.size, str):
        name, _, turned = page.size.strip().lower().partition(" ")
        turned = turned.strip()
        if name not in SIZES or turned not in ("", "portrait", "landscape"):
            raise JobError(
                "job",
                f'unknown page "{page.size[:40]}"',
                "page.size",
                f'use one of {", ".join(SIZES)}, "A4 landscape" for the long side down, or [w, h]',
            )
        width, height = SIZES[name]
        return (height, width) if turned == "landscape" else (width, height)
    if len(page.size) != 2 or min(page.size) <= 0:
        raise JobError(
            "job",
            f"{page.size} is not a width and a height",
            "page.size",
            "give [width, height] in mm",
        )
    return page.size[0], page.size[1]
