"""camgen: checked robot and machine programs from drawings, photos and models."""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from camgen.model.version import __version__

if TYPE_CHECKING:
    from camgen.build import Result, build

#: What this package offers, and the module that each name comes from when it is first asked for: their imports take
#: longer than ``--help`` may.
_HOMES = {"Result": "build", "build": "build"}

__all__ = ["Result", "__version__", "build"]


class _Door(ModuleType):
    """A package whose functions go before its folders of the same name: ``camgen.build`` is the function, also after
    Python has imported the module and would bind it to that name.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'camgen' has no attribute {name!r}")
    found = getattr(import_module(f"camgen.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)


sys.modules[__name__].__class__ = _Door
