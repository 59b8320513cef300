"""Other judges of the syntax of the languages that camgen reads.

None is a part of camgen. A judge returns whether it accepts a form of a language, None if it cannot
judge it.
"""

from __future__ import annotations

import ctypes
import importlib
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bench.read.bnf import read_grammar
from bench.read.productions import Form
from bench.read.replay import LONGEST
from tests.support import canon

Judge = Callable[[Form], bool | None]


def _succeeds(command: list[str], folder: str | None = None) -> bool:
    """Whether a process ends with 0, within 30 s."""
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=30, check=False)
    return done.returncode == 0


def by_tree_sitter(language: Any) -> Judge:
    """A grammar of tree-sitter. It has the form without the lines around it."""
    sitter = importlib.import_module("tree_sitter")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser = sitter.Parser(sitter.Language(language))
    return lambda form: not parser.parse((form.text + "\n").encode()).root_node.has_error


def by_library(path: str) -> Judge:
    """A compiled grammar of tree-sitter for G-code."""
    function = ctypes.CDLL(str(Path(path).resolve())).tree_sitter_gcode
    function.restype = ctypes.c_void_p
    return by_tree_sitter(function())


def by_pygcode(_path: str) -> Judge:
    """The package pygcode, which reads a line at a time."""
    line = importlib.import_module("pygcode").Line

    def accepts(form: Form) -> bool:
        try:
            for text in form.text.split("\n"):
                line(text)
        except Exception:  # it has no error class of its own
            return False
        return True

    return accepts


def by_linuxcnc(_path: str) -> Judge:
    """LinuxCNC's interpreter, rs274: the form in its lines; only forms of its own dialect."""

    def accepts(form: Form) -> bool | None:
        if "linuxcnc" not in form.dialects:
            return None
        return not canon.run(form.whole, timeout=LONGEST).error

    return accepts


def by_grbl(path: str) -> Judge:
    """GRBL's parser, the program gvalidate of its simulator; only forms of its own dialect."""

    def accepts(form: Form) -> bool | None:
        if "grbl" not in form.dialects:
            return None
        # It leaves a file of its memory where it is run.
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "form.nc")
            file.write_text(form.whole)
            return _succeeds([path, "-s", str(file)], folder)

    return accepts


#: Tokens that the grammar of BossyMr/intellij-rapid leaves to its lexer.
_RAPID_TOKENS = (
    (
        "INTEGER_LITERAL",
        r"0x[0-9a-f]+|0b\d*|0o\d*|\d+\.\d*(?:e[+-]?\d*)?|\.\d+(?:e[+-]?\d*)?|\d+(?:e[+-]?\d*)?",
    ),
    ("STRING_LITERAL", r'"(?:[^\r\n"]|"")*"'),
    ("IDENTIFIER", r"[^\W\d]\w*|_\w*"),
)


def by_bnf(path: str) -> Judge:
    """The grammar of BossyMr/intellij-rapid, its file Rapid.bnf."""
    grammar = read_grammar(
        Path(path).read_text(encoding="utf-8"), _RAPID_TOKENS, "file", "empty_expression"
    )
    return lambda form: grammar.takes(form.whole)


def by_antlr(path: str) -> Judge:
    """The parser that ANTLR makes for Python from the grammar abb of antlr/grammars-v4.

    The grammar has declarations alone: forms within a routine are not judged.

    path: the folder of the parser.
    """
    sys.path.insert(0, path)
    runtime, lexer, parser = map(importlib.import_module, ("antlr4", "abbLexer", "abbParser"))

    def accepts(form: Form) -> bool | None:
        if "main()" in form.whole:
            return None
        tokens = lexer.abbLexer(runtime.InputStream(form.whole.rstrip("\n")))
        tree = parser.abbParser(runtime.CommonTokenStream(tokens))
        tokens.removeErrorListeners()
        tree.removeErrorListeners()
        tree._errHandler = runtime.error.ErrorStrategy.BailErrorStrategy()
        try:
            tree.module_()
        except runtime.error.Errors.ParseCancellationException:
            return False
        return True

    return accepts


def by_vim(path: str) -> Judge:
    """The errors that KnoP-01/rapid-for-vim marks in vim, by its file syntax/rapid.vim.

    It marks few: a form without a mark is not judged.
    """
    commands = [
        "syntax on", f"source {Path(path).resolve()}", "let found = 0",
        "for n in range(1, line('$')) | for k in range(1, col([n, '$'])) | "
        "if synIDattr(synID(n, k, 0), 'name') =~ 'Error' | let found = 1 | endif | endfor | endfor",
        "execute found ? 'cquit' : 'qall!'",
    ]  # fmt: skip

    def accepts(form: Form) -> bool | None:
        with tempfile.NamedTemporaryFile("w", suffix=".mod") as file:
            file.write(form.whole)
            file.flush()
            call = ["vim", "-u", "NONE", "-N", "-es", "-n", file.name]
            for command in commands:
                call += ["-c", command]
            return None if _succeeds(call) else False

    return accepts


_TRANSLATE = """
import sys
sys.path.insert(0, sys.argv[1])
import v2py
v2py.switches = ["CP", "DRY.RUN", "POWER", "ROBOT", "SCALE.ACCEL", "UPPER"]
v2py.switches += ["AUTO.POWER.OFF", "MONITORS"]
v2py.params = ["HAND.TIME", "NOT.CALIBRATED", "BELT.MODE"]
compile(v2py.translate_program(sys.argv[2]), "a", "exec")
"""


def by_translator(path: str) -> Judge:
    """The translator from V+ to Python of alexdu/robot-sandbox, whose result must be Python.

    It is written in Python 2, which ``python2.7`` runs.

    path: the folder with v2py.py.
    """

    def accepts(form: Form) -> bool:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "a.v2")
            file.write_text(form.whole, encoding="utf-8")
            return _succeeds(["python2.7", "-c", _TRANSLATE, path, str(file)])

    return accepts


_POST = """
import builtins, contextlib, sys
folder, name, out = sys.argv[1:]
sys.path.insert(0, folder)
builtins.input = lambda *_: ""
module = __import__(name)
made = []
begin = module.RobotPost.__init__
module.RobotPost.__init__ = lambda self, *a, **k: (made.append(self), begin(self, *a, **k))[1]
with contextlib.redirect_stdout(sys.stderr):
    module.test_post()
    made[0].ProgSave(out, "Program", False, False)
"""
#: Posts of ros-industrial-attic/robodk_postprocessors, with the reason for which a controller
#: refuses the sample that each writes.
POSTS: Mapping[str, Mapping[str, str]] = {
    "gcode": {},
    "rapid": {
        "ABB_RAPID_IRC5": "ArcLStart and ArcLEnd without their arguments",
        "ABB_RAPID_IRC5_Simplified": "WaitTime without its semicolon",
        "ABB_RAPID_IRC5_clad": "a statement without its semicolon",
        "ABB_RAPID_S4C": "WaitTime without its semicolon",
        "ABB_RAPID_custom_PRG": "WaitTime without its semicolon",
    },
    "vplus": dict.fromkeys(("Adept_Vplus", "Adept_Staubli_Vplus_custom"), "TCP_On() without CALL"),
    "pacscript": dict.fromkeys(("Denso_RC8", "Denso_PAC"), "a motion without TakeArm"),
}


def write_samples(language: str, path: str) -> dict[str, str]:
    """The sample programs of the posts of a language, by post.

    path: the folder with the posts.
    """
    samples = {}
    for name in POSTS[language]:
        with tempfile.TemporaryDirectory() as folder:
            call = [sys.executable, "-c", _POST, path, name, folder]
            subprocess.run(call, capture_output=True, timeout=60, check=True)
            samples[name] = "".join(
                file.read_text(encoding="utf-8") for file in sorted(Path(folder).iterdir())
            )
    return samples


#: For each language and name: makes the judge from the path that is given with its name.
JUDGES: Mapping[str, Mapping[str, Callable[[str], Judge]]] = {
    "gcode": {
        "tree-sitter": lambda _path: by_tree_sitter(
            importlib.import_module("tree_sitter_gcode").language()
        ),
        "library": by_library,
        "pygcode": by_pygcode,
        "rs274": by_linuxcnc,
        "gvalidate": by_grbl,
    },
    "rapid": {"bnf": by_bnf, "antlr": by_antlr, "vim": by_vim},
    "vplus": {"translator": by_translator},
    "pacscript": {},
}
