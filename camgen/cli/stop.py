"""What ends a command from outside: Ctrl-C, and the signals by which a system or a service asks a process to go."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Asked to end, and the terminal is gone. Windows has no SIGHUP.
_ASKED = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(BaseException):
    """A signal asked the process to end. No KeyboardInterrupt: that may end a search alone, this ends the command."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


#: What cleans up and ends a command.
Stopped = (KeyboardInterrupt, Terminated)


def exit_code(error: BaseException) -> int:
    """130 after Ctrl-C, 143 after SIGTERM: 128 and the number of the signal, as shells have it."""
    return 128 + (error.number if isinstance(error, Terminated) else signal.SIGINT)


def say_why(error: BaseException) -> str:
    """What the user is told."""
    return (
        f"ended by {signal.Signals(error.number).name}"
        if isinstance(error, Terminated)
        else "interrupted"
    )


@contextmanager
def signals_as_interrupts(last: bool = False) -> Iterator[None]:
    """In here SIGTERM and SIGHUP raise ``Terminated``. What the process was started to ignore (nohup) stays ignored.

    last: the process ends afterwards. What was to be done is done then, so that a signal has nothing to end any more.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread has to do with signals
        return
    heard = [number for number in _ASKED if signal.getsignal(number) is signal.SIG_DFL]
    for number in heard:
        signal.signal(number, _raise)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, signal.SIG_IGN if last else signal.SIG_DFL)


def _raise(number: int, _frame: FrameType | None) -> None:
    # What asks twice is in a hurry, but cleaning up takes no time.
    signal.signal(number, signal.SIG_IGN)
    raise Terminated(number)
