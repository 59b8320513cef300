"""A function that is asked the same more than once, and works it out once."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` with its answers kept by its arguments, refusals among them.

    Arguments are compared by their bytes. Functions among them only report, and are not compared.
    """
    answers: dict[bytes, Any] = {}

    def ask(*arguments: Any) -> Any:
        key = pickle.dumps([value for value in arguments if not callable(value)])
        if key not in answers:
            try:
                answers[key] = function(*arguments)
            except Exception as error:
                answers[key] = error
        if isinstance(answers[key], Exception):
            raise answers[key]
        return answers[key]

    return ask
