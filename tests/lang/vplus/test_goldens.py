"""What the post writes: the interpreter of the language and the strict read-back tell the same of it."""

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
def test_both_tell_the_same(path: Path) -> None:
    text = path.read_bytes().decode("ascii").replace("\r\n", "\n")
    assert recognise(text)
    found, strict = run({path.name: text}, RunRequest()), read({path.name: text}, {})
    assert (found.findings, found.assumed, found.stopped) == ((), (), None)
    assert strict.work is not None
    assert strict.tool is not None
    (frames,) = found.frames
    assert frames.base_from_work is not None
    assert frames.flange_from_tool is not None
    assert (frames.work, frames.base_from_work.origin) == ("cg.work", strict.work.origin)
    assert (frames.tool, frames.flange_from_tool.origin) == ("cg.tool", strict.tool.origin)
    assert list(found.lines) == list(strict.lines)
    for one, other in zip(found.body, strict.body, strict=True):
        assert type(one) is type(other)
        if isinstance(one, MoveJ | MoveL) and isinstance(other, MoveJ | MoveL):
            assert (one.speed, one.blend) == (other.speed, other.blend)
            if isinstance(one.target, Joints) or isinstance(other.target, Joints):
                assert one.target == other.target
            else:
                assert one.target.origin == other.target.origin
                assert np.array_equal(one.target.rotation, other.target.rotation)
        elif not isinstance(one, Output):  # whose name is an option of the post
            assert one == other
