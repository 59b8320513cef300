"""Notes on names that a controller has already, so that a program gets another name."""

from __future__ import annotations

from camgen.model.part import Note


def note_renamed(text: str, name: str, controller: str) -> tuple[Note, ...]:
    """The note that a program is not called as its input.

    text: name of the input.
    name: name of the program on the controller.
    controller: language of the controller.
    """
    return (
        Note(
            "assumed",
            f"the program is called {name}, not {text}",
            f"{text} is a word of {controller}, or a name that the controller has already",
        ),
    )
