"""The server of the workbench: refused requests, the changes of a page, builds, and its end."""

import json
import os
import shutil
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import ezdxf
import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.cli.build import list_rows
from camgen.workbench.builder import Builder, Report, Stage, Stopped
from camgen.workbench.perform import BuildRequest
from tests.support.benches import Bench, open_bench, start_bench
from tests.support.waiting import LONG, wait_for

pytest.importorskip("uvicorn", reason="the extra workbench is not installed")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the common workbench opens."""
    work = tmp_path_factory.mktemp("open") / "work"
    work.mkdir()
    shutil.copy(PARTS / "bracket.dxf", work / "part.dxf")
    return work


@pytest.fixture(scope="module")
def bench(folder: Path) -> Iterator[Bench]:
    with open_bench(folder, ["part.dxf"]) as opened:
        opened.wait()
        yield opened


@pytest.fixture
def undone(bench: Bench) -> Iterator[Bench]:
    """The common workbench. The changes of a test are undone afterwards."""
    yield bench
    bench.undo_all()


# Refused requests.


@pytest.mark.parametrize(
    ("path", "host"),
    [
        ("/", None),
        ("/index.html", None),
        ("/" + 43 * "A" + "/", None),
        ("/%2e%2e/", None),
        ("{root}/", "evil.example"),
        ("{root}/", "127.0.0.1"),
        ("{root}/", "127.0.0.1:1"),
        ("{root}/../../etc/passwd", None),
        ("{root}/web/../session.py", None),
        ("{root}/web/%2e%2e%2fsession.py", None),
        ("{root}/web/session.py", None),
        ("{root}/page/999", None),
    ],
)
def test_a_request_with_another_address_or_host_is_refused(
    bench: Bench, path: str, host: str | None
) -> None:
    status, body, headers = bench.send(
        "GET", path.format(root=bench.root), headers={"Host": host} if host else {}
    )
    assert status in (404, 421)
    assert b"camgen" not in body or b"terminal" in body
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Content-Type": "application/json"}, 403),
        ({"Content-Type": "application/json", "Origin": "null"}, 403),
        ({"Content-Type": "application/json", "Origin": "http://evil.example"}, 403),
        ({"Content-Type": "application/json", "Origin": "http://127.0.0.1:1"}, 403),
        (
            {"Content-Type": "application/json", "Origin": "{own}", "Sec-Fetch-Site": "cross-site"},
            403,
        ),
        ({"Content-Type": "text/plain", "Origin": "{own}"}, 415),
        ({"Content-Type": "application/x-www-form-urlencoded", "Origin": "{own}"}, 415),
        ({"Origin": "{own}"}, 415),
        ({"Content-Type": "application/json", "Origin": "{own}"}, 200),
    ],
)
def test_only_the_page_of_the_workbench_may_change_the_job(
    bench: Bench, headers: dict[str, str], status: int
) -> None:
    sent_headers = {
        name: value.format(own=f"http://{bench.host}") for name, value in headers.items()
    }
    assert bench.send("POST", f"{bench.root}/undo", b"{}", sent_headers)[0] == status


def test_another_origin_reads_nothing(bench: Bench) -> None:
    for headers in ({"Origin": "http://evil.example"}, {"Sec-Fetch-Site": "cross-site"}):
        for path in ("/", "/form", "/events", "/page/1"):
            assert bench.send("GET", bench.root + path, headers=headers)[0] == 403
    status, _, headers_sent = bench.send("GET", f"{bench.root}/form")
    assert status == 200
    assert not [name for name in headers_sent if name.lower().startswith("access-control")]


def test_the_size_of_a_request_is_limited(bench: Bench) -> None:
    page_headers = {"Origin": f"http://{bench.host}", "Content-Type": "application/json"}
    assert (
        bench.send(
            "POST", f"{bench.root}/change", headers={**page_headers, "Content-Length": "2000001"}
        )[0]
        == 413
    )
    with socket.create_connection(("127.0.0.1", bench.port), timeout=LONG) as link:
        head = (
            f"POST {bench.root}/change HTTP/1.1\r\n"
            f"Host: {bench.host}\r\nOrigin: http://{bench.host}\r\n"
        )
        link.sendall(
            (head + "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n").encode()
        )
        try:
            for _ in range(40):
                link.sendall(b"f4240\r\n" + 1_000_000 * b" " + b"\r\n")
            answer = link.recv(100)
        except OSError:
            answer = b""
    assert b" 200 " not in answer
    assert bench.wait()["tables"] == {}


@pytest.mark.parametrize(
    "text", [b"", b"[]", b"{", b'{"changes": 5}', b'{"changes": [], "more": 1}', b"\xff"]
)
def test_a_malformed_request_is_answered_with_an_error(bench: Bench, text: bytes) -> None:
    status, data, _ = bench.send("POST", f"{bench.root}/change", text)
    assert status == 400
    assert "reload" in json.loads(data)["line"]


def test_pages_load_nothing_from_other_origins(bench: Bench) -> None:
    number = bench.wait()["built"]["number"]
    shell, page = (
        bench.send("GET", f"{bench.root}/{path}")[2]["content-security-policy"]
        for path in ("", f"page/{number}")
    )
    assert "default-src 'none'" in shell
    assert "frame-ancestors 'none'" in shell
    assert "unsafe" not in shell
    assert "frame-ancestors 'self'" in page


def test_other_machines_cannot_connect(bench: Bench) -> None:
    other = next(
        (
            address[4][0]
            for address in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        ),
        "127.0.0.1",
    )
    if other.startswith("127."):
        pytest.skip("the machine has no other address")
    with pytest.raises(OSError, match=r"refused|unreachable|timed out|No route"):
        socket.create_connection((other, bench.port), timeout=5).close()


# Files.


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (["cell", "file"], "../cell.toml"),
        (["cell", "file"], "/etc/passwd"),
        (["image", "background"], "link.png"),
        (["camera", "file"], "../work2/lens.yaml"),
        (["cell", "robot"], "../arm.urdf#tool0"),
        (["cell", "machine"], "../router.txt"),
    ],
)
def test_a_page_may_name_only_files_of_the_folder(
    bench: Bench, folder: Path, path: list[str], name: str
) -> None:
    outside = folder.parent / "outside.png"
    outside.write_bytes(b"")
    if not (folder / "link.png").is_symlink():
        (folder / "link.png").symlink_to(outside)
    status, answer = bench.post("change", changes=[{"path": path, "value": name}])
    assert status == 409
    assert "outside the open folder" in answer["line"]
    assert bench.wait()["tables"] == {}


def test_a_page_may_not_name_a_mesh_outside_the_folder_or_the_file_of_a_post(bench: Bench) -> None:
    status, answer = bench.post(
        "change", changes=[{"path": ["cell", "fixtures"], "value": ["/tmp/vice.stl"]}]
    )
    assert (status, "outside the open folder" in answer["line"]) == (409, True)
    status, answer = bench.post("post", post="/tmp/post.py")
    assert (status, "is not installed" in answer["line"]) == (409, True)


def test_the_last_connection_of_a_browser_is_kept_free(bench: Bench) -> None:
    pages = [bench.states() for _ in range(4)]  # the fixture has a page as well
    for page in pages:
        next(page)
    status, text, _ = bench.send("GET", f"{bench.root}/")
    assert (status, b"open in 5 tabs" in text) == (503, True)
    pages[0].close()  # type: ignore[attr-defined]
    wait_for("a page leaves", lambda: bench.send("GET", f"{bench.root}/")[0] == 200)
    for page in pages[1:]:
        page.close()  # type: ignore[attr-defined]


# A job by the changes of a page.


def test_changes_are_built_and_saved_as_the_command_line_does(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    (tmp_path / "part.toml").write_text("# mine\n[process]\nfeed = 30 # slow\n")
    with open_bench(tmp_path, ["part.dxf", "--post", "rapid", "--set", "tool.diameter=4"]) as bench:
        state = bench.wait()
        assert state["tables"] == {"process": {"feed": 30}, "tool": {"diameter": 4}}
        assert not state["saved"]
        bench.change("operation", "lead_in", raw="5")
        bench.change("process", "feed", raw="25.5")
        state = bench.wait(lambda state: not state["stage"] and state["undo"] == 2)
        assert state["failed"] is None
        assert bench.post("save")[0] == 200
        state = bench.wait()
        assert state["saved"]
        text = (tmp_path / "part.toml").read_text()
        assert text.startswith("# mine\n[process]\nfeed = 25.5 # slow\n")
        assert state["command"] == "camgen build part.dxf --post rapid"
        saved = {path.name: path.read_bytes() for path in tmp_path.glob("*.mod")}
        assert saved
    again = tmp_path / "again"
    again.mkdir()
    assert (
        main(["build", str(tmp_path / "part.dxf"), "--post", "rapid", "-o", str(again), "-q"]) == 0
    )
    assert {path.name: path.read_bytes() for path in again.iterdir()} == saved


def test_an_error_has_the_line_of_the_command_line_and_its_setting(
    undone: Bench, folder: Path
) -> None:
    files = sorted(folder.iterdir())
    good = undone.wait()["built"]
    undone.change("process", "force", value=-1)
    state = undone.wait(lambda state: state["failed"])
    line = "error: part.toml: force must be a number >= 0, not -1 ([process])"
    assert state["failed"]["line"] == line
    assert state["failed"]["place"] == ["process", "force"]
    assert state["built"] == good
    status, answer = undone.post("save")
    assert status == 409
    assert "no program to save" in answer["line"]
    assert sorted(folder.iterdir()) == files
    assert undone.post("undo")[0] == 200
    assert undone.wait(lambda state: not state["stage"])["failed"] is None


def test_layers_contours_and_order_become_settings_of_the_job(undone: Bench) -> None:
    assert [layer["name"] for layer in undone.wait()["looked"]["layers"]] == ["HOLES", "OUTLINE"]
    assert undone.post("layer", layer="HOLES", on=False)[0] == 200
    state = undone.wait(lambda state: not state["stage"] and state["tables"])
    assert state["tables"] == {"input": {"layers": ["*", "!HOLES"]}}
    assert [(layer["name"], layer["used"]) for layer in state["looked"]["layers"]] == [
        ("HOLES", False),
        ("OUTLINE", True),
    ]
    undone.post("layer", layer="HOLES", on=True)
    assert undone.wait(lambda state: not state["stage"])["tables"] == {}
    assert undone.post("leave", names=["c3"])[0] == 200
    state = undone.wait(lambda state: not state["stage"])
    assert state["tables"] == {"operations": [{"ids": ["c1", "c2", "c4"]}]}
    assert state["failed"] is None
    assert state["left_out"] == ["c3"]
    undone.post("take", names=["c3"])
    assert undone.wait(lambda state: not state["stage"])["tables"] == {}
    undone.post("order", layers=["OUTLINE", "HOLES"])
    state = undone.wait(lambda state: not state["stage"])
    assert state["tables"] == {"tour": {"layers": ["OUTLINE", "HOLES"]}}


def test_proposed_operations_make_a_program(undone: Bench) -> None:
    undone.wait()
    assert undone.post("propose")[0] == 200
    state = undone.wait(lambda state: not state["stage"] and state["tables"].get("operations"))
    assert state["failed"] is None
    assert state["tables"]["stock"] == {"thickness": 3.0}
    assert len(state["looked"]["worked"]) == len(state["tables"]["operations"]) > 1


def test_proposed_operations_use_the_library_of_tools(tmp_path: Path) -> None:
    """The tools and operations of the job are replaced by those of the proposal."""
    shutil.copy(PARTS / "motor.dxf", tmp_path / "motor.dxf")
    row = '[[tools]]\nname = "{}"\nnumber = {}\nkind = "drill"\ndiameter = {}\n'
    row += "feed = 2.0\nspeed = 900.0\n"
    shop = row.format("five and a half", 1, 5.5) + row.format("eight", 3, 8.0)
    (tmp_path / "shop.toml").write_text(shop)
    job = '[stock]\nthickness = 5.0\n[tool]\nfile = "shop.toml"\n' + row.format("mine", 9, 3.0)
    (tmp_path / "motor.toml").write_text(f"{job}[[operations]]\ntool = 3\n")
    with open_bench(tmp_path, ["motor.dxf"]) as bench:
        bench.wait()
        assert bench.post("propose")[0] == 200
        state = bench.wait(lambda state: not state["stage"] and "mine" not in str(state["tables"]))
        assert state["failed"] is None
        assert state["tables"]["stock"] == {"thickness": 5.0}
        assert [row["name"] for row in state["tables"]["tools"]] == ["mill 8"]
        assert [row["tool"] for row in state["tables"]["operations"]][:3] == [
            "five and a half",
            "eight",
            "mill 8",
        ]


@pytest.mark.parametrize(
    "raw",
    [
        "2020-01-01",
        "nan",
        "-inf",
        "1e400",
        "9" * 30,
        "12:30:00",
        "\x00",
        "[1, {a = 2}]",
        "{",
        "'",
        '"',
        "a\u2028",
    ],
)
def test_a_wrong_text_is_reported_and_can_be_undone(bench: Bench, raw: str) -> None:
    bench.change("process", "feed", raw=raw)
    state = bench.wait(lambda state: not state["stage"] and state["tables"])
    assert state["failed"]["place"] in (["process", "feed"], []), state["failed"]
    assert state["failed"]["code"] == 2
    assert state["built"]
    bench.post("undo")
    assert bench.wait(lambda state: not state["stage"])["tables"] == {}


def test_a_job_file_with_wrong_values_opens(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    (tmp_path / "part.toml").write_text(
        f"operations = 5\ncell = 6\nwhen = 2020-01-01\nbig = {'9' * 40}\n"
    )
    with open_bench(tmp_path, ["part.dxf"]) as bench:
        state = bench.wait()
        assert state["failed"]["code"] == 2
        assert state["tables"]["when"] == "2020-01-01"
        assert bench.post("change", changes=[{"path": ["cell", "safety"], "value": 5}])[0] in (
            409,
            500,
        )
        (tmp_path / "part.toml").write_text("[process]\nfeed = 5\n")
        assert bench.wait(lambda state: not state["stage"] and not state["failed"])["tables"] == {
            "process": {"feed": 5}
        }


def test_the_program_of_an_older_job_is_not_saved(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.dxf"]) as bench:
        bench.wait()
        for feed in range(20, 30):
            bench.change("process", "feed", value=feed + 0.5)
        assert bench.post("save")[0] == 200
        assert (tmp_path / "part.toml").read_text().endswith("feed = 29.5\n")
        again = tmp_path / "again"
        again.mkdir()
        assert (
            main(["build", str(tmp_path / "part.dxf"), "--post", "gcode", "-o", str(again), "-q"])
            == 0
        )
        assert (again / "part.ngc").read_bytes() == (tmp_path / "part.ngc").read_bytes()


# Changed files, searches, builders and ends.


def test_a_file_that_changes_is_built_again(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.dxf"]) as bench:
        assert len(bench.wait()["looked"]["contours"]) == 4
        shutil.copy(PARTS / "plate.dxf", tmp_path / "part.dxf")
        state = bench.wait(
            lambda state: not state["stage"] and len(state["looked"]["contours"]) != 4
        )
        assert "part.dxf" in state["told"]
        (tmp_path / "part.toml").write_text("[process]\nfeed = 12\n")
        assert bench.wait(lambda state: state["tables"])["tables"] == {"process": {"feed": 12}}
        bench.change("process", "feed", value=13)
        (tmp_path / "part.toml").write_text("[process]\nfeed = 14\n")
        assert bench.wait(lambda state: state["changed_outside"])["tables"] == {
            "process": {"feed": 13}
        }
        assert bench.post("save")[0] == 409
        assert (tmp_path / "part.toml").read_text() == "[process]\nfeed = 14\n"
        bench.post("file", counts=True)
        assert bench.wait()["tables"] == {"process": {"feed": 14}}


def test_a_search_that_is_ended_keeps_its_best_tour(tmp_path: Path) -> None:
    drawing = ezdxf.new("R2010", units=4)
    for k in range(20):  # more holes than the exact solution of a tour takes
        drawing.modelspace().add_circle((37.0 * k % 100, 53.0 * k % 90), 2.0)
    drawing.saveas(tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.dxf"]) as bench:
        bench.wait()
        bench.post("change", changes=[{"path": ["tour", "seconds"], "value": 500}, TRACE])
        searching = bench.wait(lambda state: state["stage"].endswith("takes the best so far"))
        assert "Cancel" in searching["stage"]
        assert "Ctrl-C" not in searching["stage"]
        assert bench.post("stop")[0] == 200
        state = bench.wait()
        assert state["failed"] is None
        assert state["built"]["number"] == state["number"]
        warnings = [text for label, text, _ in state["built"]["rows"] if label == "warning"]
        assert [
            text for text in warnings if text.startswith("the search for a short tour was stopped")
        ]
        assert bench.post("save")[0] == 200
        assert (tmp_path / "part.ngc").exists()


TRACE = {"path": ["operation", "kind"], "value": "trace"}


class _Pipe:
    """The end of a pipe that keeps the messages for a process."""

    def __init__(self) -> None:
        self.sent: list[object] = []

    def send(self, message: object) -> None:
        self.sent.append(message)

    def close(self) -> None:
        pass


class _Clock:
    """An event loop that keeps delayed calls; a test runs them."""

    def __init__(self) -> None:
        self.later: list[Callable[[], None]] = []

    def call_soon_threadsafe(self, call: Callable[[], None], /) -> None:
        call()

    def call_later(self, _seconds: float, call: Callable[[], None], /) -> None:
        self.later.append(call)


def make_builder(
    stage: str, monkeypatch: pytest.MonkeyPatch
) -> tuple[Builder, _Pipe, list[Report], BuildRequest]:
    """A builder in a stage without a process, its pipe, the list of its reports, its request."""
    reports: list[Report] = []
    builder = Builder(list_rows, reports.append, _Clock())
    request, pipe = BuildRequest(1, (), "gcode", Path("part.toml"), "", Path()), _Pipe()
    monkeypatch.setattr(builder, "start", lambda: None)
    builder._link, builder._busy = pipe, request  # type: ignore[assignment]
    builder._take(None, Stage(1, stage))  # type: ignore[arg-type]
    return builder, pipe, reports, request


def test_a_second_cancel_ends_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    builder, pipe, reports, _ = make_builder(
        "ordering 3%, Cancel takes the best so far", monkeypatch
    )
    builder.stop()
    assert pipe.sent == ["end the search"]
    assert not [report for report in reports if isinstance(report, Stopped)]
    builder.stop()
    assert reports[-1] == Stopped(1)
    assert builder._busy is None


def test_a_stage_without_a_search_is_cancelled_and_its_process_ended_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    builder, pipe, reports, _ = make_builder("planning", monkeypatch)
    clock = builder._loop
    assert isinstance(clock, _Clock)
    builder.stop()
    assert pipe.sent == ["cancel"]
    for call in clock.later:
        call()
    assert reports[-1] == Stopped(1)


def test_a_change_cancels_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    builder, pipe, _, request = make_builder(
        "ordering 3%, Cancel takes the best so far", monkeypatch
    )
    builder.submit(replace(request, number=2))
    assert pipe.sent == ["cancel"]


def test_a_builder_that_was_killed_is_replaced(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.dxf"], forked=False) as bench:
        bench.wait()
        children = Path(f"/proc/{bench.process.pid}/task/{bench.process.pid}/children")
        if not children.exists():
            pytest.skip("the system does not list the children of a process")
        bench.change("tour", "seconds", value=500)
        bench.wait(lambda state: state["stage"] not in ("", "waiting"))
        for child in children.read_text().split():
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
        assert "SIGKILL" in bench.wait(lambda state: state["failed"])["failed"]["line"]
        bench.change("tour", "seconds", value=0)
        assert bench.wait(lambda state: not state["stage"])["failed"] is None


def test_the_workbench_ends_with_its_last_page_or_on_close(tmp_path: Path) -> None:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    with start_bench(tmp_path, ["part.dxf"], tmp_path / "state") as process:
        assert process.stderr is not None
        Bench(process, process.stderr.readline().split()[1]).wait()
        # It waits some seconds for another page. Meanwhile a second workbench is closed.
        with open_bench(tmp_path, ["part.dxf"], forked=False) as bench:
            assert bench.post("close")[0] == 200
            assert bench.process.wait(LONG) == 0
        wait_for("the workbench ends", lambda: process.poll() is not None)
        assert process.returncode == 0


def test_a_port_in_use_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["open", str(PARTS / "bracket.dxf"), "--port", str(port), "--no-browser"]) == 2
    assert f"--port: {port} cannot be used" in capsys.readouterr().err


def test_a_job_file_opens_the_input_of_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "part.toml").write_text("[process]\nfeed = 12\n")
    assert main(["open", str(tmp_path / "part.toml"), "--no-browser"]) == 2
    assert "no input of its name" in capsys.readouterr().err
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.toml"]) as bench:
        state = bench.wait()
        assert state["inputs"] == ["part.dxf"]
        assert state["tables"] == {"process": {"feed": 12}}


def test_an_unknown_post_is_reported_before_a_page_opens(
    capsys: pytest.CaptureFixture[str],
) -> None:
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    assert main(["open", str(part), "--no-browser", "--post", "kuka"]) == 2
    assert "post kuka: is not installed; one of gcode" in capsys.readouterr().err
