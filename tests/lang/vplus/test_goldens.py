"""The interpreter and the strict read-back give the same instructions for programs of the post."""

from pathlib import Path

import numpy as np
import pytest

from camgen.lang.programs import RunRequest
from camgen.lang.vplus.language import recognise, run
from camgen.lang.vplus.strict import read
from camgen.model.program import Joints, MoveJ, MoveL, Output

ROOT = Path(__file__).parents[3]
GOLDENS = sorted((ROOT / "fixtures/cases").glob("*/expected/*.v2"))


@pytest.mark.parametrize("path", GOLDENS, ids=[f"{path.parts[-3]}/{path.stem}" for path in GOLDENS])
def test_interpreter_and_read_back_give_the_same_instructions(path: Path) -> None:
    text = path.read_bytes().decode("ascii").replace("\r\n", "\n")
    assert recognise(text)
    executed, strict = run({path.name: text}, RunRequest()), read({path.name: text}, {})
    assert (executed.findings, executed.assumed, executed.stopped) == ((), (), None)
    assert strict.work is not None
    assert strict.tool is not None
    (frames,) = executed.frames
    assert frames.base_from_work is not None
    assert frames.flange_from_tool is not None
    assert (frames.work, frames.base_from_work.origin) == ("cg.work", strict.work.origin)
    assert (frames.tool, frames.flange_from_tool.origin) == ("cg.tool", strict.tool.origin)
    assert list(executed.lines) == list(strict.lines)
    for instruction, expected in zip(executed.body, strict.body, strict=True):
        assert type(instruction) is type(expected)
        if isinstance(instruction, MoveJ | MoveL) and isinstance(expected, MoveJ | MoveL):
            assert (instruction.speed, instruction.blend) == (expected.speed, expected.blend)
            if isinstance(instruction.target, Joints) or isinstance(expected.target, Joints):
                assert instruction.target == expected.target
            else:
                assert instruction.target.origin == expected.target.origin
                assert np.array_equal(instruction.target.rotation, expected.target.rotation)
        elif not isinstance(instruction, Output):
            # The name of an output is an option of the post.
            assert instruction == expected
