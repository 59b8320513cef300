"""The workbench as a user starts it: a process of its own, spoken to as a browser would."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from tests.support.waiting import LONG

Json = dict[str, Any]


class Bench:
    """One workbench. address: of its page."""

    def __init__(self, process: subprocess.Popen[str], address: str) -> None:
        self.process, self.address = process, address
        found = re.fullmatch(r"http://(127\.0\.0\.1:(\d+))(/[\w-]{43})/", address)
        assert found, address
        self.host, self.port, self.root = found[1], int(found[2]), found[3]

    def ask(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: dict[str, str] | None = None,
    ) -> tuple[int, bytes, http.client.HTTPMessage]:
        """Status, body and headers of an answer. headers: instead of those of the workbench's own page."""
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG)
        own = (
            {"Origin": f"http://{self.host}", "Content-Type": "application/json"}
            if method == "POST"
            else {}
        )
        link.request(method, path, body, own if headers is None else headers)
        answer = link.getresponse()
        data = answer.read()
        link.close()
        return answer.status, data, answer.headers

    def post(self, path: str, /, **asked: Any) -> tuple[int, Json]:
        status, data, _ = self.ask("POST", f"{self.root}/{path}", json.dumps(asked).encode())
        return status, json.loads(data)

    def change(self, *path: str | int, value: Any = None, raw: str | None = None) -> None:
        status, said = self.post("change", changes=[{"path": path, "value": value, "raw": raw}])
        assert status == 200, said

    def undo_all(self) -> None:
        """Undoes all changes, and waits for the job without any."""
        for _ in range(self.wait(bool)["undo"]):
            assert self.post("undo")[0] == 200
        assert self.wait()["tables"] == {}

    def states(self) -> Iterator[Json]:
        """What a page is told, from now on; the workbench counts it as a page meanwhile."""
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG)
        link.request("GET", f"{self.root}/events")
        answer = link.getresponse()
        assert answer.status == 200
        looked: Json = {}
        until = monotonic() + LONG
        try:
            while line := answer.readline():
                assert monotonic() < until, "nothing more was told"
                if line.startswith(b"data: "):
                    state = json.loads(line[6:])
                    looked = state.setdefault("looked", looked)  # told when it is new
                    yield state
        finally:
            answer.close()
            link.close()

    def wait(self, fits: Callable[[Json], Any] = lambda state: not state["stage"]) -> Json:
        """The first state that fits: without more said, the one in which nothing is built."""
        states = self.states()
        until = monotonic() + LONG
        try:
            for state in states:
                if fits(state):
                    return state
                assert monotonic() < until, state
        finally:
            states.close()  # type: ignore[attr-defined]
        raise AssertionError("the workbench has ended")


def start_bench(folder: Path, words: Sequence[str], state: Path | str) -> subprocess.Popen[str]:
    """``camgen open`` with these words, run in ``folder``.

    state: the state folder of the user, which holds the journals
    """
    command = [sys.executable, "-m", "camgen", "open", *words, "--no-browser"]
    environment = {**os.environ, "XDG_STATE_HOME": str(state)}
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment)


@contextmanager
def open_bench(folder: Path, words: Sequence[str], state: Path | None = None) -> Iterator[Bench]:
    """``camgen open`` with these words, run in ``folder``; ended afterwards.

    state: the state folder of the user; None is an empty one
    """
    with TemporaryDirectory() as empty:
        yield from _open(start_bench(folder, words, state or empty))


def _open(process: subprocess.Popen[str]) -> Iterator[Bench]:
    """A workbench that has started; ended afterwards."""
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        assert line.startswith("open "), line + process.stderr.read()
        bench = Bench(process, line.split()[1])
        keeper = bench.states()  # so that it does not end between two questions
        next(keeper)
        yield bench
        keeper.close()  # type: ignore[attr-defined]
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(LONG)
        process.stderr.close()
