"""The proof of motion: a text works the contours of the drawing, all of them, and nothing else.

`prove_motion` takes the drawing as it was read, the job, and the motions that were read back from
the text. It knows no plan, no tour and no post. Program and path are used as hints about where to
look first; a wrong hint makes a proof fail, it never makes it pass. The table in docs/proof.md
lists the facts that are proven for each operation.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from camgen.check.proof.findings import Finding, MotionProof
from camgen.check.proof.hints import Named, Program
from camgen.check.proof.motions import Controller, Rounding
from camgen.check.proof.outputs import process_signal
from camgen.check.proof.unplaced import Unplaced, count_unplaced
from camgen.model.job import Job
from camgen.model.part import Note, Part

__all__ = [
    "Controller",
    "Finding",
    "MotionProof",
    "Program",
    "Rounding",
    "Unplaced",
    "process_signal",
    "prove_motion",
]


def prove_motion(
    part: Part,
    job: Job,
    programs: Sequence[Program],
    notes: Sequence[Note],
    rounding: Rounding,
    controller: Controller | None = None,
) -> MotionProof:
    """Compares the motions of `programs` with the drawing of `part` and the settings of `job`.

    notes: all notes of the build; a contour that a note names as skipped may be left out.
    rounding: rounding of the numbers of the text.
    controller: the controller of the text. None: rounded corners and turns of the tool are not
        examined.
    """
    home = None if controller is None else controller.home
    unplaced = Unplaced()
    for program in programs:
        unplaced += count_unplaced(program.body, home, rounding.joint)
    if part.solid is not None or part.curves:
        from camgen.check.proof.space import prove_space  # noqa: PLC0415 (only for these)

        proof = prove_space(part, job, programs[0], Named.from_notes(notes), rounding)
    else:
        from camgen.check.proof.flat import prove_flat  # noqa: PLC0415 (shapely, only for these)

        proof = prove_flat(part, job, programs, notes, rounding, controller)
    return replace(proof, unplaced=unplaced)
