"""The walk of a build: the folders that it enters, in their order.

    python -m docs.make.walk             prints the walks of a drawing, a photo and a 3-D part
    python -m docs.make.walk FILE POST   prints the walk of another input

Each line is an arrow of docs/architecture.md: a function that `camgen.build` calls, and the folders
whose functions it calls.
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
#: The arrows by their functions, in order. A post is called twice: before the check it replaces
#: features that the controller lacks.
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


class WalkRecorder:
    """A profile function that records the walk.

    arrows: the arrows in the order in which they are entered, each with the folders entered by it.
    """

    def __init__(self) -> None:
        self.arrows: list[tuple[str, list[str]]] = []
        self._open = ""

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """Records calls and returns of functions of camgen."""
        module = frame.f_globals.get("__name__", "")
        if not module.startswith(("camgen.", "camgen_posts.")):
            return
        name = frame.f_code.co_name  # a method of a post, or of its base class
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
def record_walk() -> Iterator[WalkRecorder]:
    """Records the walk of the builds in its block."""
    recorder = WalkRecorder()
    sys.setprofile(recorder)
    try:
        yield recorder
    finally:
        sys.setprofile(None)


def walk_of(
    source: Path, post: str, job: Job | dict[str, object] | Path
) -> list[tuple[str, list[str]]]:
    """The arrows of one build, each with its folders in the order in which they are entered."""
    # The first build imports modules and fills caches, which is not part of the walk.
    camgen.build(source, post=post, job=job)
    with record_walk() as recorder:
        camgen.build(source, post=post, job=job)
    return recorder.arrows


def render_photo(folder: Path) -> tuple[Path, Path]:
    """A rendered photo of a plate and its job file."""
    from bench.render.photos import photos, write  # noqa: PLC0415 (only photos need the renderer)

    shot = next(iter(photos(1, 1)))
    write(folder, shot)
    picture = next(folder.glob("*.png"))
    return picture, picture.with_suffix(".toml")


def format_table(title: str, arrows: list[tuple[str, list[str]]]) -> str:
    """A walk as a table in Markdown."""
    rows = [f"| {arrow} | {', '.join(folders)} |" for arrow, folders in arrows]
    return "\n".join(
        [f"{title}:", "", "| arrow | folders entered, in this order |", "|---|---|", *rows, ""]
    )


def main() -> None:
    """Prints the walks."""
    if len(sys.argv) > 2:
        print(format_table(sys.argv[1], walk_of(Path(sys.argv[1]), sys.argv[2], {})))
        return
    print(
        format_table(
            "A drawing (`bracket.dxf`, RAPID)", walk_of(PARTS / "bracket.dxf", "rapid", {})
        )
    )
    with tempfile.TemporaryDirectory() as name:
        picture, job = render_photo(Path(name))
        print(format_table("A photo (rendered, PacScript)", walk_of(picture, "pacscript", job)))
    print(format_table("A 3-D part (`rfa1.stl`, RAPID)", walk_of(PARTS / "rfa1.stl", "rapid", {})))


if __name__ == "__main__":
    main()
