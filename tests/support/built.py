"""Programs that several tests only look at: each is built once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import camgen
from camgen.pipeline import Result

#: Programs that are kept; the oldest makes room for a new one.
_MOST = 48
_KEPT: dict[tuple[str, bytes, str, str], Result] = {}


def build(part: Path, post: str, job: Mapping[str, object]) -> Result:
    """``camgen.build`` of a drawing or model in a file.

    A program is known by the name and the bytes of its part, the post and the tables of its job.
    Files that the tables name must not change.
    """
    key = part.name, part.read_bytes(), post, json.dumps(job)
    if key not in _KEPT:
        result = camgen.build(part, post=post, job=job)
        if len(_KEPT) == _MOST:
            del _KEPT[next(iter(_KEPT))]
        _KEPT[key] = result
    return _KEPT[key]
