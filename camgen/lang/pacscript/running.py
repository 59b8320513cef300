"""What the steps of a PacScript program may ask of the run that they belong to."""

from __future__ import annotations

from typing import Protocol

from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.machine import Machine, Scope
from camgen.lang.pacscript.source import Module, Procedure
from camgen.lang.pacscript.values import Value


class Running(Protocol):
    """A run. scope: the names of the procedure that runs, module_scope: those of its file; stems: files by the name
    that programs call them.
    """

    machine: Machine
    scope: Scope
    module_scope: Scope
    stems: dict[str, str]

    def read(self, name: str) -> Module:
        """The module of a file that is given."""

    def find_procedure(self, name: str) -> tuple[Module, Procedure] | None:
        """A procedure of this file, or the start of another one."""

    def find_function(self, name: str) -> bool:
        """Whether a name without brackets calls a function."""

    def call(self, found: tuple[Module, Procedure], parts: tuple[Node, ...]) -> Value:
        """Calls a procedure; what it gives."""

    def signal(self, at: int) -> Value:
        """An input, or an output as the program has set it."""

    def set_signal(self, at: int, value: Value) -> None:
        """Sets an output."""

    def port(self, name: str) -> Value | None:
        """What an input or output with a name of its own is."""

    def write_port(self, name: str, value: Value) -> bool:
        """Sets such an output; whether there is one."""

    def learn(self, node: Node, value: Value) -> None:
        """Takes a variable or an input for what a program has waited for."""

    def told_by_user(self, node: Node) -> str:
        """What of a condition the user has said himself."""

    def undeclared(self, name: str) -> Value:
        """A name that nobody has given a value."""

    def left_out(self, name: str) -> Value:
        """A procedure that is in no file."""
