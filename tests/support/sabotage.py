"""Deliberate faults: functions of camgen are replaced by functions with another result."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from camgen.model.body import Body
from camgen.model.program import Program

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
Patch = pytest.MonkeyPatch


def module(name: str) -> Any:
    return importlib.import_module(f"camgen.{name}")


def change_result(patch: Patch, where: str, name: str, change: Callable[[Any], Any]) -> None:
    """Replaces a function of a module by one whose result is changed."""
    target = module(where)
    original = getattr(target, name)

    def changed(*given: Any, **named: Any) -> Any:
        return change(original(*given, **named))

    patch.setattr(target, name, changed)


def change_program(patch: Patch, change: Callable[[Body], Body]) -> None:
    """Changes the body of the program that `lower` makes."""

    def changed(program: Program) -> Program:
        return program.with_body(change(program.body))

    change_result(patch, "pipeline", "lower", changed)


def with_columns(body: Body, **columns: Any) -> Body:
    return Body(replace(body.packed, **columns), body.rotations, body.objects)
