"""The server of the workbench: its pages on 127.0.0.1, until they are closed."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from importlib import resources
from typing import Any

import msgspec
import uvicorn
from msgspec import Struct
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from camgen.model.errors import CamgenError, JobError, make_one_line
from camgen.workbench import choose
from camgen.workbench import session as steps
from camgen.workbench.desk import Desk, Edited, Ending, Warn
from camgen.workbench.guard import PAGE_POLICY, PICTURE_POLICY, SHELL_POLICY, guard
from camgen.workbench.perform import InputSummary, Summarize
from camgen.workbench.session import Change, Session, Tables

#: Time without a page after which the workbench ends, s. A reload takes less.
_STAY = 4.0
#: Period in which the workbench looks whether it has to end, s.
_LOOK = 0.1
#: Period of a message to each page, s, which fails if the page has crashed.
_BEAT = 10.0
#: A browser opens six connections to a server, and each page keeps one for its state. The page
#: waits for the answer to a change, which needs another one.
_MOST_PAGES = 5
#: Answers a request, or what it holds if its type is known. None stands for an empty answer.
Answer = Callable[[Desk, Any], Awaitable[Response | None]]
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}


def open_socket(port: int) -> socket.socket:
    """A socket on 127.0.0.1. port: 0 for any free port. Raises JobError for a port in use."""
    # With the protocol named, asyncio turns Nagle's algorithm off, which delays answers by 40 ms.
    door = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        door.bind(("127.0.0.1", port))
        door.listen()  # A browser that connects before the server runs waits.
    except (OSError, OverflowError) as error:
        door.close()
        raise JobError(
            "--port",
            f"{port} cannot be used: {getattr(error, 'strerror', None) or error}",
            remedy="give another one, or leave it out",
        ) from error
    return door


class CommandLine(Struct, frozen=True):
    """The functions of the command line that a workbench calls.

    summarize: makes the summary of a build
    warn: writes a line about the journal
    ready: called once the page can be opened
    """

    summarize: Summarize
    warn: Warn
    ready: Callable[[], None]


def serve(session: Session, terminal: CommandLine, token: str, door: socket.socket) -> Ending:
    """Serve the workbench until its last page is closed, or Ctrl-C is pressed."""
    desks: list[Desk] = []
    servers: list[uvicorn.Server] = []
    app = _make_app(session, terminal, desks, servers)
    settings = uvicorn.Config(
        guard(app, token, door.getsockname()[1]),
        log_level="critical",
        access_log=False,
        server_header=False,
        root_path="",
        timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=64_000,
    )
    servers.append(uvicorn.Server(settings))
    with suppress(KeyboardInterrupt):
        servers[0].run(sockets=[door])
    return desks[0].end()


def _make_app(
    session: Session, terminal: CommandLine, desks: list[Desk], servers: list[uvicorn.Server]
) -> Starlette:
    """The application. Its start adds the desk to `desks`; `servers` has its server by then."""

    @asynccontextmanager
    async def run_desk(_app: Starlette) -> AsyncIterator[None]:
        desk = Desk(session, terminal.summarize, terminal.warn)
        desks.append(desk)
        waiting = _wait_for_end(desk, servers[0])
        tasks = list(map(asyncio.ensure_future, (desk.watch_files(), waiting)))
        terminal.ready()
        desk.open_journals()
        try:
            yield
        finally:
            desk.closing = True
            desk.notify_pages()
            for task in tasks:
                task.cancel()
            desk.builder.close()

    def route(path: str, answer: Answer, method: str, content: type | None) -> Route:
        async def respond(request: Request) -> Response:
            return await _answer(desks[0], request, answer, content)

        return Route("/{token}" + path, respond, methods=[method])

    gets: dict[str, Answer] = {
        "/": _shell,
        "/web/{name}": _asset,
        "/page/{number:int}": _page,
        "/picture/{number:int}": _picture,
        "/form": _form,
        "/events": _events,
    }
    posts: dict[str, tuple[Answer, type | None]] = {
        "/change": (_change, _Changes),
        "/draft": (_draft, Change),
        "/journal": (_journal, _File),
        "/post": (_post, _Post),
        "/layer": (_layer, _Layer),
        "/order": (_order, _Layers),
        "/move": (_move, _Move),
        "/seam": (_seam, _Seam),
        "/leave": (_leave, _Names),
        "/take": (_take, _Names),
        "/undo": (_undo, None),
        "/redo": (_redo, None),
        "/build": (_build, None),
        "/stop": (_stop, None),
        "/propose": (_propose, None),
        "/save": (_save, _Save),
        "/file": (_file, _File),
        "/close": (_close, None),
    }
    routes = [route(path, answer, "GET", None) for path, answer in gets.items()]
    routes += [route(path, answer, "POST", content) for path, (answer, content) in posts.items()]
    return Starlette(routes=routes, lifespan=run_desk)


async def _answer(desk: Desk, request: Request, answer: Answer, content: type | None) -> Response:
    """The answer to a request. An error becomes one line, as on the command line.

    content: the type of what the request holds; None if `answer` takes the request itself.
    """
    try:
        if content is None:
            return await answer(desk, request) or _json({})
        held: object = msgspec.json.decode(await request.body(), type=content)
        return await answer(desk, held) or _json({})
    except Edited as error:
        return JSONResponse({"line": f"error: {error}", "edited": error.names}, 409)
    except CamgenError as error:
        return JSONResponse({"line": f"error: {error}"}, 409)
    except (msgspec.MsgspecError, ClientDisconnect):
        return JSONResponse({"line": "error: the page sent an invalid request; reload it"}, 400)
    except Exception as error:  # any fault is a line on the page, as in cli.main
        return JSONResponse({"line": make_one_line(f"fault: {type(error).__name__}: {error}")}, 500)


async def _wait_for_end(desk: Desk, server: uvicorn.Server) -> None:
    """End the workbench when its last page has been gone for some seconds.

    Close and Ctrl-C end it too. The server first answers its pages, which have the state to the
    end.
    """
    seconds_away = 0.0
    while seconds_away < _STAY and not desk.closing and not server.should_exit:
        await asyncio.sleep(_LOOK)
        is_away = desk.is_visited and not desk.pages
        seconds_away = seconds_away + _LOOK if is_away else 0.0
    desk.closing = True
    desk.notify_pages()
    server.should_exit = True


# Requests that load a page or its parts.


async def _shell(desk: Desk, _request: Request) -> Response:
    if desk.pages >= _MOST_PAGES:
        text = f"this workbench is open in {_MOST_PAGES} tabs: close one of them, then reload\n"
        return Response(text, 503)
    return _static("index.html")


async def _asset(_desk: Desk, request: Request) -> Response:
    name = request.path_params["name"]
    return _static(name) if name in _ASSETS else Response("no such file\n", 404)


_WEB = resources.files("camgen.workbench") / "web"
_ASSETS = frozenset(file.name for file in _WEB.iterdir() if file.is_file())


def _static(name: str) -> Response:
    text = (_WEB / name).read_text(encoding="utf-8")
    kind = _TYPES["." + name.rpartition(".")[2]]
    return Response(text, media_type=kind, headers={"content-security-policy": SHELL_POLICY})


async def _page(desk: Desk, request: Request) -> Response:
    """The preview of the last successful build. The preview of another one is gone."""
    if desk.built is None or desk.built.number != request.path_params["number"]:
        return Response("this build is no longer there\n", 404)
    headers = {"content-security-policy": PAGE_POLICY}
    return Response(desk.built.page, media_type="text/html", headers=headers)


async def _picture(desk: Desk, _request: Request) -> Response:
    text = desk.pictured.picture
    headers = {"content-security-policy": PICTURE_POLICY}
    return Response(text, 200 if text else 404, media_type="image/svg+xml", headers=headers)


async def _form(desk: Desk, _request: Request) -> Response:
    return _json(desk.form)


async def _events(desk: Desk, _request: Request) -> Response:
    return StreamingResponse(_states(desk), media_type="text/event-stream")


async def _states(desk: Desk) -> AsyncIterator[bytes]:
    """The state after each change, as server-sent events."""
    queue = desk.join()
    sent = None
    try:
        yield b"retry: 1000\n\n"
        while True:
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(queue.get(), _BEAT)
                state = desk.state()
                if desk.last.summary is not sent:
                    sent = state["looked"] = desk.last.summary
                yield b"data: " + msgspec.json.encode(state) + b"\n\n"
                if desk.closing:
                    return
                continue
            yield b": still here\n\n"
    finally:
        desk.leave(queue)


def _json(value: object) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")


# Requests that change the state.


class _Changes(Struct, forbid_unknown_fields=True):
    changes: list[Change]


class _Post(Struct, forbid_unknown_fields=True):
    post: str


class _Layer(Struct, forbid_unknown_fields=True):
    layer: str
    on: bool


class _Layers(Struct, forbid_unknown_fields=True):
    layers: list[str]


class _Move(Struct, forbid_unknown_fields=True):
    """build: number of the build whose picture the user saw"""

    build: int
    path: int
    to: int


class _Seam(Struct, forbid_unknown_fields=True):
    """A start point of a closed path.

    build: number of the build whose picture the user saw
    path: index of the path
    x, y: mm; None leaves the start point to camgen
    draft: whether the ring may still move
    """

    build: int
    path: int
    x: float | None = None
    y: float | None = None
    draft: bool = False


class _Names(Struct, forbid_unknown_fields=True):
    names: list[str]
    row: int = -1


class _File(Struct, forbid_unknown_fields=True):
    counts: bool


class _Save(Struct, forbid_unknown_fields=True):
    """replace: whether programs that were changed by hand are replaced"""

    replace: bool = False


def _replace_tables(desk: Desk, tables: Tables) -> None:
    desk.replace_session(steps.add_step(desk.session, tables))


async def _change(desk: Desk, content: _Changes) -> None:
    desk.change(content.changes)


async def _draft(desk: Desk, change: Change) -> None:
    """Keep a text while it is typed."""
    desk.draft(change)


async def _journal(desk: Desk, journal: _File) -> None:
    """Take up, or drop, the changes of an earlier workbench."""
    desk.answer_offer(journal.counts)


async def _post(desk: Desk, chosen: _Post) -> None:
    """Choose an installed controller, or the file that the command named, never another file."""
    if chosen.post not in desk.session.posts:
        raise JobError(
            f"post {chosen.post[:60]}",
            "is not installed",
            remedy=f"one of {', '.join(desk.session.posts)}",
        )
    desk.replace_session(steps.add_step(desk.session, desk.session.tables, chosen.post))


async def _layer(desk: Desk, change: _Layer) -> None:
    _replace_tables(desk, choose.switch_layer(desk.session.tables, change.layer, change.on))


async def _order(desk: Desk, order: _Layers) -> None:
    _replace_tables(desk, steps.set_value(desk.session.tables, ["tour", "layers"], order.layers))


async def _move(desk: Desk, move: _Move) -> None:
    summary = _get_summary(desk, move.build)
    _replace_tables(desk, choose.move_path(desk.session.tables, summary, move.path, move.to))


async def _seam(desk: Desk, seam: _Seam) -> None:
    place = None if seam.x is None or seam.y is None else (seam.x, seam.y)
    summary = _get_summary(desk, seam.build)
    tables = choose.move_seam(desk.session.tables, summary, seam.path, place)
    change = Change(["tour", "seams"], tables.get("tour", {}).get("seams"))
    if not seam.draft:
        desk.change([change])
    elif place is None:
        desk.draft(Change(change.path))
    else:
        desk.draft(change)


async def _leave(desk: Desk, chosen: _Names) -> None:
    tables = choose.leave_out(desk.session.tables, _get_summary(desk), chosen.names, chosen.row)
    _replace_tables(desk, tables)


async def _take(desk: Desk, chosen: _Names) -> None:
    _replace_tables(desk, choose.restore(desk.session.tables, _get_summary(desk), chosen.names))


def _get_summary(desk: Desk, build: int | None = None) -> InputSummary:
    """The content of the input in the last successful build.

    build: number of the build that the user saw, None for any. Raises JobError for an older one.
    """
    if desk.built is None:
        raise JobError("page", "nothing is built yet", remedy="wait for the first program")
    if build not in (None, desk.built.number):
        raise JobError("page", "the picture is of an older program", remedy="wait for the new one")
    return desk.built.summary


async def _undo(desk: Desk, _request: Request) -> None:
    desk.replace_session(steps.undo(desk.session))


async def _redo(desk: Desk, _request: Request) -> None:
    desk.replace_session(steps.redo(desk.session))


async def _build(desk: Desk, _request: Request) -> None:
    desk.request_build()


async def _stop(desk: Desk, _request: Request) -> None:
    desk.stop()


async def _propose(desk: Desk, _request: Request) -> None:
    desk.request_build(propose=True)


async def _save(desk: Desk, settings: _Save) -> Response:
    return _json({"written": [str(path) for path in await desk.save(settings.replace)]})


async def _file(desk: Desk, file: _File) -> None:
    """Choose the job file or the form, if both were changed."""
    if file.counts:
        desk.load_job()
    else:
        desk.keep_job()


async def _close(desk: Desk, _request: Request) -> None:
    desk.closing = True
