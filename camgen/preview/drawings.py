"""Writes a preview by the suffix of its name: a page, a picture, or a drawing of the input."""

from __future__ import annotations

from pathlib import Path

from camgen.model.errors import JobError
from camgen.preview import Built, list_seen
from camgen.preview.fixtures import clip_fixtures
from camgen.read import is_drawing


def check_preview(name: str | None) -> None:
    """Raise JobError for a name without the suffix of a preview."""
    if name and Path(name).suffix.lower() not in _PREVIEWS:
        raise JobError(
            name,
            "a preview is a page (HTML) or a drawing (SVG, PNG)",
            remedy="give a name that ends in .html, .svg or .png",
        )


def draw_preview(result: Built, target: Path) -> bytes:
    """The preview of `result` as the bytes of the file `target`."""
    return _PREVIEWS[target.suffix.lower()](result)


def _page(result: Built) -> bytes:
    from camgen.preview.page import format_page  # noqa: PLC0415 (only for pages)
    from camgen.preview.view import make_view  # noqa: PLC0415

    return format_page(make_view(result)).encode("utf-8")


def _picture(result: Built) -> bytes:
    from camgen.preview.png import draw_png  # noqa: PLC0415 (only for pictures)
    from camgen.preview.view import make_view  # noqa: PLC0415

    return draw_png(make_view(result))


def _drawing(result: Built) -> bytes:
    if result.part.solid is not None and not result.part.curves:
        from camgen.preview.solid_svg import format_solid_svg  # noqa: PLC0415 (only for 3-D parts)
        from camgen.preview.view import make_view  # noqa: PLC0415

        return format_solid_svg(make_view(result), result.part.solid).encode("utf-8")
    from camgen.preview import drawing_stages, photo_stages, svg  # noqa: PLC0415 (only for SVG)

    part, title = result.part, f"{result.part.source}, {result.post.name}"
    if part.raster is not None and is_drawing(result.job):
        return drawing_stages.svg(result, part.raster, title).encode("utf-8")
    if part.raster is not None:
        return photo_stages.svg(part, part.raster, result.tour, result.notes, title).encode("utf-8")
    standing = svg.DrawnFixtures(clip_fixtures(result), result.blocked)
    seen = list_seen(result)
    return svg.format_svg(part, result.tour, result.notes, title, seen, standing).encode("utf-8")


#: The function that draws a preview, by the suffix of its name.
_PREVIEWS = {".html": _page, ".svg": _drawing, ".png": _picture}
