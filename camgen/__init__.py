"""camgen: checked robot and machine programs from drawings, photos and models.

`build` makes a program in one call. `read`, `plan`, `order`, `lower`, `check`, `post` and `verify`
are its stages, with the values between them; docs/python.md has examples.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from camgen.model.version import __version__

if TYPE_CHECKING:
    from camgen.lang.programs import Executed
    from camgen.model.errors import (
        CamgenError,
        InputError,
        JobError,
        NoSafeProgram,
        Refused,
        VerifyError,
    )
    from camgen.model.job import Job
    from camgen.model.part import Contour, Edge, Note, Part, Solid
    from camgen.model.path import ToolPath, Tour
    from camgen.model.pose import Pose
    from camgen.model.program import (
        Comment,
        Force,
        Joints,
        MoveC,
        MoveJ,
        MoveL,
        Origin,
        Output,
        Program,
        Wait,
    )
    from camgen.pipeline import Result, build
    from camgen.pipeline.stages import (
        cell,
        check,
        job,
        lower,
        order,
        part,
        plan,
        post,
        preview,
        read,
        read_back,
        verify,
    )  # fmt: skip
    from camgen.plan import Operation, Plan
    from camgen.post import Post
    from camgen.read import Reader
    from camgen.robots.workcell import Workcell

#: The names of each module. A module is imported when one of its names is first used: all imports
#: together take longer than `--help` may.
_NAMES = {
    "pipeline": "Result build",
    "pipeline.stages": "cell check job lower order part plan post preview read read_back verify",
    "lang.programs": "Executed",
    "model.errors": "CamgenError InputError JobError NoSafeProgram Refused VerifyError",
    "model.job": "Job",
    "model.part": "Contour Edge Note Part Solid",
    "model.path": "ToolPath Tour",
    "model.pose": "Pose",
    "model.program": "Comment Force Joints MoveC MoveJ MoveL Origin Output Program Wait",
    "plan": "Operation Plan",
    "post": "Post",
    "read": "Reader",
    "robots.workcell": "Workcell",
}
#: The module of each name.
_HOMES: dict[str, str] = {}
for _home, _names in _NAMES.items():
    _HOMES |= dict.fromkeys(_names.split(), _home)

__all__ = [
    "CamgenError", "Comment", "Contour", "Edge", "Executed", "Force", "InputError", "Job",
    "JobError", "Joints", "MoveC", "MoveJ", "MoveL", "NoSafeProgram", "Note", "Operation", "Origin",
    "Output", "Part", "Plan", "Pose", "Post", "Program", "Reader", "Refused", "Result", "Solid",
    "ToolPath", "Tour", "VerifyError", "Wait", "Workcell", "__version__", "build", "cell", "check",
    "job", "lower", "order", "part", "plan", "post", "preview", "read", "read_back", "verify",
]  # fmt: skip


class _Door(ModuleType):
    """A package whose functions have priority over its folders of the same name.

    `camgen.plan` stays the function. Python would replace it by the folder when it imports that.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'camgen' has no attribute {name!r}")
    value: object = getattr(import_module(f"camgen.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


sys.modules[__name__].__class__ = _Door
