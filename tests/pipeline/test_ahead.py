"""While a picture is decoded, the modules of later stages are loaded."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from camgen.pipeline.ahead import load_later_stages
from camgen.vision.image import read_picture
from tests.support.files import source

GEAR = Path(__file__).parents[2] / "fixtures" / "parts" / "gear.png"
#: Builds a program of a photo and prints the modules that were loaded, with what
#: `load_later_stages` loads if it is called beside the decoding, or without.
SCRIPT = """
import importlib, json, sys
import camgen
ahead = importlib.import_module("camgen.pipeline.ahead")
pipeline = importlib.import_module("camgen.pipeline")

loaded = []
if sys.argv[2] == "without":
    pipeline.load_later_stages = lambda post: loaded.append(set(sys.modules))
else:
    pipeline.load_later_stages = lambda post: (
        ahead.load_later_stages(post), loaded.append(set(sys.modules))
    )
camgen.build(sys.argv[1], post="pacscript", job={"image": {"mm_per_px": 0.1}})
(before,) = loaded
print(json.dumps([sorted(before), sorted(set(sys.modules) - before)]))
"""


def list_loaded(how: str) -> tuple[list[str], list[str]]:
    """The modules that are loaded when a picture is decoded, and those that are loaded later."""
    words = [sys.executable, "-c", SCRIPT, str(GEAR), how]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    before, later = json.loads(done.stdout)
    return before, later


def test_what_is_loaded_ahead_is_what_a_build_needs_later() -> None:
    at_first, needed = map(set, list_loaded("without"))
    before, later = list_loaded("with")
    ahead = set(before) - at_first
    assert {"camgen.plan.follow", "camgen.check.proof.flat"} <= ahead & needed
    assert "camgen.lang.pacscript.strict" in ahead & needed
    # Nothing is loaded that the build does not need, except by the libraries, and little is left.
    assert {name for name in ahead if name.startswith("camgen.")} <= needed
    assert len(later) < len(needed) / 5


@pytest.mark.parametrize("post", ["gcode", "another", "folder/own.py"])
def test_a_post_without_such_a_module_is_no_error(post: str) -> None:
    load_later_stages(post)


def test_work_beside_the_decoding_has_ended_when_the_picture_is_there() -> None:
    done: list[str] = []
    picture = read_picture(source(GEAR), meanwhile=lambda: done.append("once"))
    assert done == ["once"]
    assert picture.pixels.size
