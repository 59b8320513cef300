"""``camgen completion``: a script that lets bash, zsh or fish complete commands, options and their values.

It is made from the parser of the command line, so it knows what camgen knows. Posts, robots and settings stand in it as
they are when it is made: completing starts no Python.
"""

from __future__ import annotations

import argparse
from argparse import Namespace
from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from camgen.cli import parsers
from camgen.cli.say import Voice, out
from camgen.cli.schema import schema
from camgen.post.plugins import installed
from camgen.robots.catalogue import robots


class _Option(Struct, frozen=True):
    """An option: its names, whether a value follows, and which values there are."""

    names: tuple[str, ...]
    about: str
    valued: bool
    values: _Values


class _Values(Struct, frozen=True):
    """What may stand in a place: words, and whether the names of files too. glued: more follows without a space."""

    words: tuple[str, ...] = ()
    files: bool = False
    glued: bool = False


class _Verb(Struct, frozen=True):
    """A command: its options, and what its other words are."""

    name: str
    about: str
    options: tuple[_Option, ...]
    rest: _Values


def run(arguments: Namespace, _says: Voice) -> int:
    """Prints the script."""
    out(_SCRIPTS[arguments.shell](_verbs()))
    return 0


def _verbs() -> list[_Verb]:
    top, commands = parsers()
    abouts = {choice.dest: choice.help or "" for choice in _actions(top)[-1]._choices_actions}  # type: ignore[attr-defined]
    known = _known()
    found = []
    for name, sub in commands.items():
        actions = _actions(sub)
        options = tuple(_option(action, known) for action in actions if action.option_strings)
        rest = [_values(action, known) for action in actions if not action.option_strings]
        found.append(_Verb(name, abouts[name], options, rest[0] if rest else _Values()))
    return found


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return parser._actions  # argparse has no public list


def _known() -> dict[str, _Values]:
    """The values that camgen knows, by the name of the argument."""
    # Of a robot's name capitals, spaces and hyphens do not matter: without them it is one word.
    arms = tuple("".join(c for c in robot.name.casefold() if c.isalnum()) for robot in robots())
    return {
        "post": _Values(tuple(post.name for post in installed()), files=True),
        "robot": _Values(arms, files=True),
        "sets": _Values(tuple(_assignments(arms)), glued=True),
    }


def _assignments(arms: tuple[str, ...]) -> Iterator[str]:
    """Settings as ``table.key=``, and with their values where those are known."""
    for table, content in schema()["properties"].items():
        for key, kind in content.get("properties", {}).items():
            choices = arms if (table, key) == ("cell", "robot") else kind.get("enum", ())
            yield f"{table}.{key}="
            yield from (f"{table}.{key}={choice}" for choice in choices)


def _option(action: argparse.Action, known: dict[str, _Values]) -> _Option:
    about = (action.help or "").replace("%%", "%")
    return _Option(tuple(action.option_strings), about, action.nargs != 0, _values(action, known))


#: Arguments that are files say so by how they are shown, e.g. FILE.toml or PHOTO.
_FILES = ("FILE", "DIR", "INPUT", "GLOB", "PROGRAM", "PLAN", "PHOTO", "MODEL", "SCAN")


def _values(action: argparse.Action, known: dict[str, _Values]) -> _Values:
    if action.dest in known:
        return known[action.dest]
    if action.choices:
        return _Values(tuple(str(choice) for choice in action.choices))
    return _Values(files=action.nargs != 0 and str(action.metavar or "").startswith(_FILES))


# -- bash


def _bash(verbs: list[_Verb]) -> str:
    cases = []
    for verb in verbs:
        flags = " ".join(name for option in verb.options for name in option.names)
        cases += [f"    {verb.name})", '        case "$before" in']
        for option in verb.options:
            if option.valued:
                cases += [f"            {line}" for line in _bash_cases(option)]
        rest = f"if [[ $word == -* ]]; then _camgen_words '{flags}'; else {_bash_words(verb.rest)}; fi"
        cases += [f"            *) {rest} ;;", "        esac ;;"]
    names = " ".join(verb.name for verb in verbs)
    return _BASH.replace("NAMES", names).replace("CASES", "\n".join(cases))


def _bash_cases(option: _Option) -> list[str]:
    """What follows an option. For bash a word ends at ``=``: what follows that is a case of its own."""
    first = tuple(word for word in option.values.words if word.partition("=")[2] == "")
    choices: dict[str, list[str]] = {}
    for name, _, value in (word.partition("=") for word in option.values.words):
        if value:
            choices.setdefault(name, []).append(value)
    cases = [f"{name}) {_bash_words(_Values(tuple(values)))} ;;" for name, values in choices.items()]
    return [f"{'|'.join(option.names)}) {_bash_words(replace(option.values, words=first))} ;;", *cases]


def _bash_words(values: _Values) -> str:
    more = " files" if values.files else " glued" if values.glued else ""
    return f"_camgen_words '{' '.join(values.words)}'{more}"


_BASH = """\
# Completion of camgen for bash. In ~/.bashrc: eval "$(camgen completion bash)"
_camgen_words() {
    COMPREPLY=($(compgen -W "$1" -- "$word"))
    if [[ $2 == files ]]; then
        local file
        while IFS= read -r file; do COMPREPLY+=("$file"); done < <(compgen -f -- "$word")
        compopt -o filenames 2>/dev/null
    elif [[ $2 == glued ]]; then
        compopt -o nospace 2>/dev/null
    fi
}
_camgen() {
    local at=$COMP_CWORD
    local word=${COMP_WORDS[at]}
    if [[ $word == = ]]; then
        word=
    elif [[ ${COMP_WORDS[at - 1]} == = ]]; then
        at=$((at - 1))
    fi
    local before=${COMP_WORDS[at - 1]}
    COMPREPLY=()
    if [[ $COMP_CWORD == 1 ]]; then
        _camgen_words 'NAMES --help --version'
        return
    fi
    case "${COMP_WORDS[1]}" in
CASES
    esac
}
complete -F _camgen camgen
"""


# -- zsh


def _zsh(verbs: list[_Verb]) -> str:
    cases = []
    for verb in verbs:
        lines = [f"            {spec}" for option in verb.options for spec in _zsh_option(option)]
        rest = f"            '*:{verb.name}:{_zsh_values(verb.rest)}'"
        cases += [f"        {verb.name})", "            _arguments -S \\", *(f"    {line} \\" for line in lines)]
        cases += [f"    {rest} ;;"]
    names = "\n".join(f"        {_quoted(f'{verb.name}:{verb.about}')}" for verb in verbs)
    return _ZSH.replace("NAMES", names).replace("CASES", "\n".join(cases))


def _zsh_option(option: _Option) -> list[str]:
    about = "".join(f"\\{c}" if c in "[]:\\" else c for c in option.about)
    value = f":value:{_zsh_values(option.values)}" if option.valued else ""
    many = "*" if option.names == ("--set",) else ""
    return [_quoted(f"{many}{name}[{about}]{value}") for name in option.names]


def _zsh_values(values: _Values) -> str:
    words = " ".join(values.words)
    if values.glued:
        return f'{{compadd -S "" -- {words}}}'
    if values.words and values.files:
        return f"{{compadd -- {words}; _files}}"
    return f"({words})" if words else "_files" if values.files else " "


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


_ZSH = """\
#compdef camgen
# Completion of camgen for zsh. In ~/.zshrc, after compinit: eval "$(camgen completion zsh)"
_camgen() {
    local -a commands
    commands=(
NAMES
    )
    if (( CURRENT == 2 )); then
        _describe command commands
        _arguments -S '--help[show help]' '--version[show the version]'
        return
    fi
    local verb=${words[2]}
    shift words
    (( CURRENT-- ))
    case "$verb" in
CASES
    esac
}
compdef _camgen camgen
"""


# -- fish


def _fish(verbs: list[_Verb]) -> str:
    lines = [
        "# Completion of camgen for fish. In ~/.config/fish/config.fish: camgen completion fish | source",
        "complete -c camgen -f",
        "complete -c camgen -n __fish_use_subcommand -l version -d 'show the version'",
    ]
    for verb in verbs:
        lines.append(f"complete -c camgen -n __fish_use_subcommand -a {verb.name} -d {_fish_text(verb.about)}")
        when = f"complete -c camgen -n '__fish_seen_subcommand_from {verb.name}'"
        for option in verb.options:
            flags = " ".join(f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in option.names)
            value = f" -r{_fish_values(option.values)}" if option.valued else ""
            lines.append(f"{when} {flags}{value} -d {_fish_text(option.about)}")
        if rest := _fish_values(verb.rest):
            lines.append(f"{when}{rest}")
    return "\n".join(lines) + "\n"


def _fish_values(values: _Values) -> str:
    words = f" -a {_fish_text(' '.join(values.words))}" if values.words else ""
    return (" -F" if values.files else "") + words


def _fish_text(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


_SCRIPTS = {"bash": _bash, "zsh": _zsh, "fish": _fish}
