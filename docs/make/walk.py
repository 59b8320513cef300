"""The walk of a build as it really runs: which folders are entered, in which order.

    python -m docs.make.walk             builds a drawing, a photo and a 3-D part, and prints the walk of each
    python -m docs.make.walk FILE POST   that of another input

A line is an arrow of the house: the function that ``camgen.build`` calls, the folders that work for it, and what comes
out.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import camgen
from camgen.model.job import Job

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
#: The arrows by the function that each is, in order. Posts are asked twice: first to replace what they lack.
ARROWS = {
    "camgen.pipeline.inputs.read_inputs": "read",
    "camgen.plan.plan": "plan",
    "camgen.order.order": "order",
    "camgen.lower.lower": "lower",
    "camgen.post.contract.prepare_program": "post (replace what the controller lacks)",
    "camgen.check.check": "check",
    "camgen.post.contract.render_program": "post (print)",
    "camgen.post.verify.compare": "verify",
}
_BUILD = ("camgen.pipeline", "camgen.pipeline.programs")


class Walk:
    """The arrows in the order in which they are entered, each with the folders that were entered meanwhile."""

    def __init__(self) -> None:
        self.arrows: list[tuple[str, list[str]]] = []
        self._open = ""

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """A profile function: looks at calls and returns of camgen's own functions."""
        module = frame.f_globals.get("__name__", "")
        if not module.startswith(("camgen.", "camgen_posts.")):
            return
        name = frame.f_code.co_name  # of a post, its own or that of its base
        name = name if name in ARROWS else f"{module}.{name}"
        if event == "call" and not self._open and name in ARROWS and self._called_by_build(frame):
            self._open = name
            self.arrows.append((ARROWS[name], []))
        elif event == "return" and name == self._open and self._called_by_build(frame):
            self._open = ""
        if event == "call" and self._open:
            folder = module.split(".")[1] if module.startswith("camgen.") else "postprocessors"
            folders = self.arrows[-1][1]
            if folder not in folders and folder != "pipeline":
                folders.append(folder)

    @staticmethod
    def _called_by_build(frame: FrameType) -> bool:
        back = frame.f_back
        return back is not None and back.f_globals.get("__name__") in _BUILD


@contextmanager
def walked() -> Iterator[Walk]:
    """Records the walk of what is built meanwhile."""
    walk = Walk()
    sys.setprofile(walk)
    try:
        yield walk
    finally:
        sys.setprofile(None)


def walk_of(
    source: Path, post: str, job: Job | dict[str, object] | Path
) -> list[tuple[str, list[str]]]:
    """The arrows of one build, each with its folders in the order in which they are entered."""
    camgen.build(source, post=post, job=job)  # what is loaded only once is not part of the walk
    with walked() as walk:
        camgen.build(source, post=post, job=job)
    return walk.arrows


def photo(folder: Path) -> tuple[Path, Path]:
    """A rendered photo of a plate and its job file."""
    from bench.render.photos import photos, write  # noqa: PLC0415 (only this walk needs the renderer)

    shot = next(iter(photos(1, 1)))
    write(folder, shot)
    picture = next(folder.glob("*.png"))
    return picture, picture.with_suffix(".toml")


def table(title: str, arrows: list[tuple[str, list[str]]]) -> str:
    """One walk as Markdown."""
    rows = [f"| {arrow} | {', '.join(folders)} |" for arrow, folders in arrows]
    return "\n".join(
        [f"{title}:", "", "| arrow | folders entered, in this order |", "|---|---|", *rows, ""]
    )


def main() -> None:
    """Prints the walks."""
    if len(sys.argv) > 2:
        print(table(sys.argv[1], walk_of(Path(sys.argv[1]), sys.argv[2], {})))
        return
    print(table("A drawing (`bracket.dxf`, RAPID)", walk_of(PARTS / "bracket.dxf", "rapid", {})))
    with tempfile.TemporaryDirectory() as name:
        picture, job = photo(Path(name))
        print(table("A photo (rendered, PacScript)", walk_of(picture, "pacscript", job)))
    print(table("A 3-D part (`rfa1.stl`, RAPID)", walk_of(PARTS / "rfa1.stl", "rapid", {})))


if __name__ == "__main__":
    main()
