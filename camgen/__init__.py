"""camgen: checked robot and machine programs from drawings, photos and models."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from camgen.job import Result, build

__all__ = ["Result", "__version__", "build"]
__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """``build`` and ``Result`` come when they are asked for: their imports take longer than ``--help`` may."""
    if name in ("Result", "build"):
        import importlib  # noqa: PLC0415

        return getattr(importlib.import_module("camgen.job"), name)
    raise AttributeError(f"module 'camgen' has no attribute {name!r}")
