"""The command `completion`: a script with which bash, zsh or fish complete commands and options.

shtab makes the script from the parser of the command line. The script holds the posts, robots and
settings of the moment, so that completion does not start Python.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator

import shtab

from camgen.cli import make_parsers
from camgen.cli.say import Terminal
from camgen.post.job_schema import schema
from camgen.post.plugins import list_installed
from camgen.robots.catalogue import list_robots

#: Arguments that are files say so by how they are shown, e.g. FILE.toml or PHOTO.
_FILES = ("FILE", "DIR", "INPUT", "GLOB", "PROGRAM", "PLAN", "PHOTO", "MODEL", "SCAN")


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Prints the script."""
    top, commands = make_parsers()
    # The name of a robot is recognised without capitals, spaces and hyphens: then it is one word.
    arms = ["".join(filter(str.isalnum, robot.name.casefold())) for robot in list_robots()]
    known = {
        "post": _words_or_files("post", [post.name for post in list_installed()]),
        "robot": _words_or_files("robot", arms),
        "sets": _settings(list(_assignments(arms))),
    }
    for sub in commands.values():
        for action in sub._actions:  # argparse has no public list
            # shtab knows the choices by itself.
            if action.dest in known:
                action.complete = known[action.dest]  # type: ignore[attr-defined]
            elif action.nargs != 0 and str(action.metavar).startswith(_FILES):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    terminal.out(_amend(shtab.complete(top, arguments.shell), arguments.shell))


def _assignments(arms: list[str]) -> Iterator[str]:
    """Settings as ``table.key=``, and with their values where those are known."""
    for table, content in schema()["properties"].items():
        for key, kind in content.get("properties", {}).items():
            choices = arms if (table, key) == ("cell", "robot") else kind.get("enum", ())
            yield f"{table}.{key}="
            yield from (f"{table}.{key}={choice}" for choice in choices)


def _words_or_files(name: str, values: list[str]) -> shtab.CompleteType:
    """Words or files. shtab knows by the name of a function that bash has to escape file names."""
    words = " ".join(values)
    return _functions(
        f"_camgen_{name}_or_file",
        bash=f'compgen -W "{words}" -- "$1"; compgen -f -- "$1"',
        zsh=f"compadd -- {words}; _files",
        fish=f"printf '%s\\n' {words}; __fish_complete_path (commandline -ct)",
    )


def _settings(assignments: list[str]) -> shtab.CompleteType:
    """Settings: in bash names first, and values when the name stands."""
    words = " ".join(assignments)
    names = " ".join(word for word in assignments if word.endswith("="))
    values = " ".join(word for word in assignments if not word.endswith("="))
    return _functions(
        "_camgen_settings",
        bash=f'[[ $1 == *=* ]] && compgen -W "{values}" -- "$1" || compgen -W "{names}" -- "$1"',
        zsh=f"compadd -S '' -- {words}",
        fish=f"printf '%s\\n' {words}",
    )


def _functions(name: str, bash: str, zsh: str, fish: str) -> shtab.CompleteType:
    preamble = {
        "bash": f"{name}() {{ {bash}; }}",
        "zsh": f"{name}() {{ {zsh} }}",
        "fish": f"function {name}; {fish}; end",
    }
    return {"bash": name, "zsh": name, "fish": f"({name})", "preamble": preamble}


def _amend(script: str, shell: str) -> str:
    """Correct the faults of shtab 1.13 in the script (docs/development/libraries.md)."""
    if shell == "bash":
        return script + _BASH
    if shell == "zsh":
        # Complete all files of a command, not the first alone. Allow the script to be sourced.
        return script.replace('"(*):', '"*:').replace("[-1] == eval", "[-1] != loadautofunc")
    return script


#: bash ends a word at `=`. These lines join the words before shtab's function reads them.
_BASH = """

_camgen() {
    local word last=-1 glue= words=()
    for word in "${COMP_WORDS[@]:0:COMP_CWORD + 1}"; do
        if [[ $word == = ]]; then
            # The value of an option is a word of its own, that of a setting belongs to it.
            if [[ ${words[last]} == --* ]]; then words[++last]=; else words[last]+==; fi
            glue=1
        elif [[ $glue ]]; then
            words[last]+=$word
            glue=
        else
            words[++last]=$word
        fi
    done
    local COMP_WORDS=("${words[@]}") COMP_CWORD=$last
    _shtab_camgen
    if ((last == 1)) && [[ ! ${words[1]} ]]; then COMPREPLY+=(--help --version); fi
    if [[ ${COMPREPLY[0]} == *= ]]; then compopt -o nospace 2>/dev/null; fi
    if [[ ${words[last]} == *=* ]]; then COMPREPLY=("${COMPREPLY[@]#*=}"); fi
}
complete -o bashdefault -F _camgen camgen
"""
