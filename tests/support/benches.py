"""The workbench in a separate process, with the requests of a browser."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import pytest

from tests.support.forks import get_server, start_process
from tests.support.waiting import LONG

Json = dict[str, Any]


class Bench:
    """A running workbench.

    address: address of its page.
    """

    def __init__(self, process: "subprocess.Popen[str] | ForkedBench", address: str) -> None:
        self.process, self.address = process, address
        match = re.fullmatch(r"http://(127\.0\.0\.1:(\d+))(/[\w-]{43})/", address)
        assert match, address
        self.host, self.port, self.root = match[1], int(match[2]), match[3]

    def send(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: dict[str, str] | None = None,
    ) -> tuple[int, bytes, http.client.HTTPMessage]:
        """Status, body and headers of an answer.

        headers: headers of the request; None sends those of the page of the workbench.
        """
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG)
        page_headers = (
            {"Origin": f"http://{self.host}", "Content-Type": "application/json"}
            if method == "POST"
            else {}
        )
        link.request(method, path, body, page_headers if headers is None else headers)
        answer = link.getresponse()
        data = answer.read()
        link.close()
        return answer.status, data, answer.headers

    def post(self, path: str, /, **arguments: Any) -> tuple[int, Json]:
        status, data, _ = self.send("POST", f"{self.root}/{path}", json.dumps(arguments).encode())
        return status, json.loads(data)

    def change(self, *path: str | int, value: Any = None, raw: str | None = None) -> None:
        status, answer = self.post("change", changes=[{"path": path, "value": value, "raw": raw}])
        assert status == 200, answer

    def undo_all(self) -> None:
        """Undoes all changes, and waits for the job without any."""
        for _ in range(self.wait(bool)["undo"]):
            assert self.post("undo")[0] == 200
        assert self.wait()["tables"] == {}

    def states(self) -> Iterator[Json]:
        """The states that a page receives from now on. The workbench counts it as a page."""
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG)
        link.request("GET", f"{self.root}/events")
        answer = link.getresponse()
        assert answer.status == 200
        looked: Json = {}
        deadline = monotonic() + LONG
        try:
            while line := answer.readline():
                assert monotonic() < deadline, "no further state"
                if line.startswith(b"data: "):
                    state = json.loads(line[6:])
                    looked = state.setdefault("looked", looked)  # sent only if it is new
                    yield state
        finally:
            answer.close()
            link.close()

    def wait(self, fits: Callable[[Json], Any] = lambda state: not state["stage"]) -> Json:
        """The first state that fits; the default fits a state without a running build."""
        states = self.states()
        deadline = monotonic() + LONG
        try:
            for state in states:
                if fits(state):
                    return state
                assert monotonic() < deadline, state
        finally:
            states.close()  # type: ignore[attr-defined]
        raise AssertionError("the workbench has ended")


def start_bench(folder: Path, words: Sequence[str], state: Path | str) -> subprocess.Popen[str]:
    """Starts `camgen open` with these words in a folder.

    state: the state folder of the user, which holds the journals.
    """
    command = [sys.executable, "-m", "camgen", "open", *words, "--no-browser"]
    environment = {**os.environ, "XDG_STATE_HOME": str(state)}
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment)


def run_open(
    folder: Path, words: Sequence[str], environment: dict[str, str], errors: Connection
) -> None:
    """Runs `camgen open` in this process. errors: takes what it writes to its error stream."""
    from camgen.cli import main  # noqa: PLC0415 (in the process of the workbench alone)

    # The server that has forked this process forks its builders as well.
    server, patch = get_server(), pytest.MonkeyPatch()
    patch.setattr(forkserver._forkserver, "ensure_running", lambda: None)
    patch.setattr("camgen.workbench.builder.get_context", lambda _: server)
    os.dup2(errors.fileno(), 2)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.exit(main(["open", *words, "--no-browser"]))


class ForkedBench:
    """A process like that of `start_bench`, forked by a server that has imported camgen.

    Tests of how a workbench or its builder begins or ends do not use it.
    """

    def __init__(self, folder: Path, words: Sequence[str], state: str) -> None:
        server, environment = get_server(), {**os.environ, "XDG_STATE_HOME": state}
        ours, theirs = server.Pipe(duplex=False)
        self._process = start_process(run_open, folder, words, environment, theirs)
        theirs.close()
        self.stderr = os.fdopen(os.dup(ours.fileno()), encoding="utf-8")
        ours.close()
        assert self._process.pid is not None
        self.pid: int = self._process.pid

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, seconds: float) -> int:
        self._process.join(seconds)
        assert self._process.exitcode is not None, f"it runs after {seconds:g} s"
        return self._process.exitcode


@contextmanager
def open_bench(
    folder: Path, words: Sequence[str], state: Path | None = None, forked: bool = True
) -> Iterator[Bench]:
    """Runs `camgen open` with these words in a folder, and ends it afterwards.

    state: the state folder of the user; None stands for an empty one
    forked: whether the process is a `ForkedBench`, where the system has them
    """
    start = ForkedBench if forked and os.name != "nt" else start_bench
    with TemporaryDirectory() as empty:
        yield from _open(start(folder, words, str(state or empty)))


def _open(process: subprocess.Popen[str] | ForkedBench) -> Iterator[Bench]:
    """A workbench that has started; ended afterwards."""
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        assert line.startswith("open "), line + process.stderr.read()
        bench = Bench(process, line.split()[1])
        keeper = bench.states()  # The workbench ends without a page.
        next(keeper)
        yield bench
        keeper.close()  # type: ignore[attr-defined]
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(LONG)
        process.stderr.close()
