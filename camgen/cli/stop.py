"""The end of a command from outside: Ctrl-C, and signals that ask a process to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Signals of a request to end, and of a closed terminal. Windows has no SIGHUP.
_SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(BaseException):
    """A signal asked the process to end.

    It is not a KeyboardInterrupt, which may end a search alone.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


#: Exceptions after which a command cleans up and ends.
Stopped = (KeyboardInterrupt, Terminated)


def exit_code(error: BaseException) -> int:
    """128 plus the number of the signal, as in shells: 130 after Ctrl-C, 143 after SIGTERM."""
    return 128 + (error.number if isinstance(error, Terminated) else signal.SIGINT)


def format_reason(error: BaseException) -> str:
    """The message for the user."""
    if isinstance(error, Terminated):
        return f"ended by {signal.Signals(error.number).name}"
    return "interrupted"


@contextmanager
def raise_signals(last: bool = False) -> Iterator[None]:
    """Raise `Terminated` for SIGTERM and SIGHUP. Signals that the process ignores stay ignored.

    last: the process ends afterwards. Its work is done then, so further signals are ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Only the main thread handles signals.
        return
    handled = [number for number in _SIGNALS if signal.getsignal(number) is signal.SIG_DFL]
    for number in handled:
        signal.signal(number, _raise)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, signal.SIG_IGN if last else signal.SIG_DFL)


def _raise(number: int, _frame: FrameType | None) -> None:
    # A second signal would interrupt the cleaning up, which takes no time.
    signal.signal(number, signal.SIG_IGN)
    raise Terminated(number)
