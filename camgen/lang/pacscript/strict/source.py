"""The strict reader of PacScript files: what no program of a post has outside its statements."""

from __future__ import annotations

import re
from collections.abc import Mapping

from camgen.lang.pacscript.lines import CLOSING, DEFINE, FaultCallback
from camgen.lang.pacscript.source import File, Module, Reader, Statement
from camgen.lang.pacscript.words import name_fault

from .values import TYPES

_OPENING = re.compile(r"(?:sub|function)\s+\w+\s*(?:\([^()]*\))?\s*(?:as\s+\w+)?", re.IGNORECASE)


class StrictReader(Reader):
    """Reads a file. Directives except `#Define`, and declarations outside procedures are faults."""

    def __init__(
        self,
        module: Module,
        files: Mapping[str, File],
        report: FaultCallback,
        remark: FaultCallback,
    ) -> None:
        super().__init__(module, files, report)
        self.remark = remark

    def directive(
        self,
        line: int,
        text: str,
        active: list[str],  # noqa: ARG002 (there is no #If)
        depth: int,
    ) -> None:
        """Reads a directive."""
        define = DEFINE.fullmatch(text)
        if define is None:
            self.add_fault(line, f"{text.split(maxsplit=1)[0]} is not evaluated")
            return
        self.remark(line, "#Define, which no program of the post has")
        self._check_names(line, define[1])
        self.order(line, "define", text, "", depth)

    def statement(self, line: int, text: str, start: str) -> None:
        """Reads a statement."""
        if _OPENING.fullmatch(text) or CLOSING.fullmatch(text):
            super().statement(line, text, start)
        elif self.current is None:
            self.add_fault(line, "a statement outside a procedure")
        else:
            self.current.statements.append(Statement(line, text))

    def open(self, line: int, opening: re.Match[str], start: str) -> None:
        """Reads the declaration of a procedure."""
        super().open(line, opening, start)
        procedure = self.current
        if procedure is None:
            return
        parameters = procedure.parameters
        names = {parameter.name for parameter in parameters}
        if len(names) < len(parameters) or any(item.kind not in TYPES for item in parameters):
            self.add_fault(line, "parameters that cannot be read")
            procedure.parameters = [item._replace(kind="variant") for item in parameters]
        self._check_names(line, *(parameter.name for parameter in parameters))
        if procedure.name == "main" and parameters:
            self.add_fault(line, "Main has parameters, but no statement calls it with values")

    def _check_names(self, line: int, *names: str) -> None:
        """Adds findings for names that the language does not accept."""
        for name in names:
            if what := name_fault(name):
                self.add_fault(line, what)
