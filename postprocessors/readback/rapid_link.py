"""RAPID modules put together: who sees which name, and what is declared twice or cannot be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from camgen.post import Fault

from .rapid_data import PREDEFINED, Scope, Value
from .rapid_lexis import Wrong
from .rapid_tree import Data, Module, Routine


@dataclass
class Linked:
    """The modules of a program, put together: who sees which name."""

    longest_name: int
    faults: list[Fault] = field(default_factory=list)
    data: dict[str, Data] = field(default_factory=dict)  # what is global, by name in lower case
    routines: dict[str, Routine] = field(default_factory=dict)
    modules: list[Module] = field(default_factory=list)
    scopes: dict[Routine, Scope] = field(default_factory=dict)
    home: dict[Routine, dict[str, Routine]] = field(default_factory=dict)  # the local routines a routine sees
    worth: dict[Data, Value] = field(default_factory=dict)
    failed: dict[Data, Wrong] = field(default_factory=dict)

    def add(self, module: Module) -> None:
        """Enters a module; its names must be legal, and new where they are seen."""
        if any(module.name.lower() == other.name.lower() for other in self.modules):
            self.fault(module.line, f"a second module {module.name}")
        self.modules.append(module)
        self.legal(module.name, module.line)
        names: set[str] = set()
        members: tuple[Data | Routine, ...] = (*module.data, *module.routines)
        for item in members:
            key = item.name.lower()
            self.legal(item.name, item.line)
            if key in names or (not item.local and (key in self.data or key in self.routines)):
                self.fault(item.line, f"{item.name} is declared twice")
            if not item.local and key == module.name.lower():
                self.fault(item.line, f"{item.name} is global and has the name of its module")
            names.add(key)
        self.data |= {d.name.lower(): d for d in module.data if not d.local}
        self.routines |= {r.name.lower(): r for r in module.routines if not r.local}

    def legal(self, name: str, line: int) -> None:
        """Notes a name that is too long or taken by the system."""
        if len(name) > self.longest_name:
            self.fault(line, f"{name[:40]} is longer than {self.longest_name} characters")
        if name.lower() in PREDEFINED:
            self.fault(line, f"{name} is predefined")

    def fault(self, line: int, what: str) -> None:
        """Notes a fault."""
        self.faults.append(Fault(line, what))

    def check(self) -> None:
        """Values every declaration, so that one that is wrong is reported even when nothing uses it."""
        for module in self.modules:
            local = {d.name.lower(): d for d in module.data if d.local}
            routines = {r.name.lower(): r for r in module.routines if r.local}
            self.value_all(self.scope(local, self.data), module.data)
            for routine in module.routines:
                for data in routine.data:
                    self.legal(data.name, data.line)
                own = {d.name.lower(): d for d in routine.data}
                self.scopes[routine] = self.scope(own, local, self.data)
                self.home[routine] = routines
                self.value_all(self.scopes[routine], routine.data)

    def scope(self, *levels: Mapping[str, Data]) -> Scope:
        """A scope that shares what is known of declarations."""
        return Scope(levels, self.worth, self.failed)

    def value_all(self, scope: Scope, data: tuple[Data, ...]) -> None:
        """Notes what is wrong with the values of declarations."""
        for item in data:
            try:
                if item.value is not None:
                    scope.worth_of(item)
            except Wrong as wrong:
                self.faults.append(wrong.fault)

    def find(self, caller: Routine, name: str) -> Routine | None:
        """The PROC that ``name`` means in ``caller``."""
        return self.home[caller].get(name) or self.routines.get(name)
