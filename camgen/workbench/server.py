"""The door of the workbench: its pages on 127.0.0.1, until they are closed."""

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

from camgen.model.errors import CamgenError, JobError, one_line
from camgen.workbench import choose
from camgen.workbench import session as steps
from camgen.workbench.desk import Desk, Edited, Ending, Warn
from camgen.workbench.guard import PAGE_POLICY, PICTURE_POLICY, SHELL_POLICY, guard
from camgen.workbench.perform import Looked, Tell
from camgen.workbench.session import Change, Session

#: The last page may be gone for so long before the workbench ends, s: a reload takes a moment. Nobody hears a page that
#: has crashed: it is asked this often, s, whether it is still there.
_STAY, _BEAT = 4.0, 10.0
#: A browser opens six connections to a server, and each page keeps one for its state. The page
#: waits for the answer to a change, which needs another one.
_MOST_PAGES = 5
Answer = Callable[[Desk, Request], Awaitable[Response]]
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}


def listen(port: int) -> socket.socket:
    """A socket on 127.0.0.1. port: 0 for any that is free. JobError where it is not to be had."""
    # With the protocol named, asyncio turns Nagle's algorithm off, which delays answers by 40 ms.
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind(("127.0.0.1", port))
        found.listen()  # whoever comes before the server runs waits for it
    except (OSError, OverflowError) as error:
        found.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise JobError(
            "--port", f"{port} cannot be used: {reason}", remedy="give another one, or leave it out"
        ) from error
    return found


class Shop(Struct, frozen=True):
    """The command line's side of a workbench.

    tell: function that makes the summary of a build
    warn: writes a line about the journal
    ready: called once the page can be opened
    """

    tell: Tell
    warn: Warn
    ready: Callable[[], None]


def serve(session: Session, shop: Shop, token: str, door: socket.socket) -> Ending:
    """Serves the workbench until its last page is closed, or Ctrl-C is pressed."""
    desks: list[Desk] = []
    ends: list[uvicorn.Server] = []
    app = _app(session, shop, desks, lambda: _end(ends[0]))
    settings = uvicorn.Config(
        guard(app, token, door.getsockname()[1]),
        log_level="critical",
        access_log=False,
        server_header=False,
        root_path="",
        timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=64_000,
    )
    ends.append(uvicorn.Server(settings))
    with suppress(KeyboardInterrupt):
        ends[0].run(sockets=[door])
    return desks[0].end()


def _end(server: uvicorn.Server) -> None:
    server.should_exit = True


def _app(session: Session, shop: Shop, desks: list[Desk], end: Callable[[], None]) -> Starlette:
    """The application. desks: gets the desk when it starts"""

    @asynccontextmanager
    async def living(_app: Starlette) -> AsyncIterator[None]:
        desk = Desk(session, shop.tell, shop.warn)
        desks.append(desk)
        tasks = [
            asyncio.ensure_future(one) for one in (desk.watch_files(), _wait_for_end(desk, end))
        ]
        shop.ready()
        desk.open_journals()
        try:
            yield
        finally:
            desk.closing = True
            desk.tell_all()
            for task in tasks:
                task.cancel()
            desk.builder.close()

    def route(path: str, answer: Answer, method: str = "GET") -> Route:
        async def answered(request: Request) -> Response:
            return await _answer(desks[0], request, answer)

        return Route("/{token}" + path, answered, methods=[method])

    gets: dict[str, Answer] = {
        "/": _shell,
        "/web/{name}": _asset,
        "/page/{number:int}": _page,
        "/picture/{number:int}": _picture,
    }
    gets |= {"/form": _form, "/events": _events}
    posts: dict[str, Answer] = {
        "/change": _change,
        "/draft": _draft,
        "/journal": _journal,
        "/post": _post,
        "/layer": _layer,
        "/order": _order,
        "/move": _move,
        "/seam": _seam,
        "/leave": _leave,
        "/take": _take,
    }
    posts |= {
        "/undo": _undo,
        "/redo": _redo,
        "/build": _build,
        "/stop": _stop,
        "/propose": _propose,
        "/save": _save,
        "/file": _file,
        "/close": _close,
    }
    routes = [*(route(path, answer) for path, answer in gets.items())]
    routes += [route(path, answer, "POST") for path, answer in posts.items()]
    return Starlette(routes=routes, lifespan=living)


async def _answer(desk: Desk, request: Request, answer: Answer) -> Response:
    """What is wrong with what a page asked for is its one line, as on the command line."""
    try:
        return await answer(desk, request)
    except Edited as error:
        return JSONResponse({"line": f"error: {error}", "edited": error.names}, 409)
    except CamgenError as error:
        return JSONResponse({"line": f"error: {error}"}, 409)
    except (msgspec.MsgspecError, ClientDisconnect):
        return JSONResponse({"line": "error: the page sent what makes no sense; reload it"}, 400)
    except Exception as error:  # whatever it is, it is a line in the page, as in cli.main
        return JSONResponse({"line": one_line(f"fault: {type(error).__name__}: {error}")}, 500)


async def _wait_for_end(desk: Desk, end: Callable[[], None]) -> None:
    """Ends the workbench when its last page has been gone for some seconds."""
    while not desk.is_visited and not desk.closing:
        await asyncio.sleep(0.1)
    away = 0.0
    while away < _STAY and not desk.closing:
        await asyncio.sleep(0.2)
        away = 0.0 if desk.pages else away + 0.2
    desk.closing = True
    desk.tell_all()
    await asyncio.sleep(0.1)  # so that the pages hear of it
    end()


# What pages load.


async def _shell(desk: Desk, _request: Request) -> Response:
    if desk.pages >= _MOST_PAGES:
        text = f"this workbench is open in {_MOST_PAGES} tabs: close one of them, then reload\n"
        return Response(text, 503)
    return _static("index.html")


async def _asset(_desk: Desk, request: Request) -> Response:
    name = request.path_params["name"]
    return _static(name) if name in _ASSETS else Response("no such file\n", 404)


_WEB = resources.files("camgen.workbench") / "web"
_ASSETS = frozenset(one.name for one in _WEB.iterdir() if one.is_file())


def _static(name: str) -> Response:
    text = (_WEB / name).read_text(encoding="utf-8")
    kind = _TYPES["." + name.rpartition(".")[2]]
    return Response(text, media_type=kind, headers={"content-security-policy": SHELL_POLICY})


async def _page(desk: Desk, request: Request) -> Response:
    """The preview of the last good build, under its number: that of another one is gone."""
    if desk.built is None or desk.built.number != request.path_params["number"]:
        return Response("this build is no longer there\n", 404)
    return Response(
        desk.built.page, media_type="text/html", headers={"content-security-policy": PAGE_POLICY}
    )


async def _picture(desk: Desk, _request: Request) -> Response:
    text = desk.picture()
    headers = {"content-security-policy": PICTURE_POLICY}
    return Response(text, 200 if text else 404, media_type="image/svg+xml", headers=headers)


async def _form(desk: Desk, _request: Request) -> Response:
    return _json(desk.form)


async def _events(desk: Desk, _request: Request) -> Response:
    return StreamingResponse(_states(desk), media_type="text/event-stream")


async def _states(desk: Desk) -> AsyncIterator[bytes]:
    """The state whenever it is new (server-sent events)."""
    queue = desk.join()
    known = None
    try:
        yield b"retry: 1000\n\n"
        while True:
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(queue.get(), _BEAT)
                state = (
                    desk.state() if desk.looked is known else desk.state() | {"looked": desk.looked}
                )
                known = desk.looked
                yield b"data: " + msgspec.json.encode(state) + b"\n\n"
                if desk.closing:
                    return
                continue
            yield b": still here\n\n"
    finally:
        desk.leave(queue)


def _json(value: object) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")


_DONE: dict[str, Any] = {}


# What pages ask for.


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
    """build: whose picture the user saw."""

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


async def _change(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Changes)
    desk.change(asked.changes)
    return _json(_DONE)


async def _draft(desk: Desk, request: Request) -> Response:
    """A text while it is typed."""
    desk.draft(msgspec.json.decode(await request.body(), type=Change))
    return _json(_DONE)


async def _journal(desk: Desk, request: Request) -> Response:
    """Whether the changes of an earlier workbench are taken up."""
    answer = msgspec.json.decode(await request.body(), type=_File)
    desk.answer_offer(answer.counts)
    return _json(_DONE)


async def _post(desk: Desk, request: Request) -> Response:
    """Another controller: one that is installed, or the file that the command named, never another file."""
    asked = msgspec.json.decode(await request.body(), type=_Post)
    if asked.post not in desk.session.posts:
        raise JobError(
            f"post {asked.post[:60]}",
            "is not installed",
            remedy=f"one of {', '.join(desk.session.posts)}",
        )
    desk.become(steps.step(desk.session, desk.session.tables, asked.post))
    return _json(_DONE)


async def _layer(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Layer)
    desk.become(
        steps.step(desk.session, choose.switch_layer(desk.session.tables, asked.layer, asked.on))
    )
    return _json(_DONE)


async def _order(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Layers)
    desk.become(steps.step(desk.session, choose.order_layers(desk.session.tables, asked.layers)))
    return _json(_DONE)


async def _move(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Move)
    tables = choose.move_path(desk.session.tables, _looked(desk, asked.build), asked.path, asked.to)
    desk.become(steps.step(desk.session, tables))
    return _json(_DONE)


async def _seam(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Seam)
    place = None if asked.x is None or asked.y is None else (asked.x, asked.y)
    tables = choose.move_seam(desk.session.tables, _looked(desk, asked.build), asked.path, place)
    seams = Change(["tour", "seams"], tables.get("tour", {}).get("seams"))
    if not asked.draft:
        desk.change([seams])
    elif place is None:
        desk.draft(Change(seams.path))
    else:
        desk.draft(seams)
    return _json(_DONE)


async def _leave(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Names)
    tables = choose.leave_out(desk.session.tables, _looked(desk), asked.names, asked.row)
    desk.become(steps.step(desk.session, tables))
    return _json(_DONE)


async def _take(desk: Desk, request: Request) -> Response:
    asked = msgspec.json.decode(await request.body(), type=_Names)
    desk.become(
        steps.step(desk.session, choose.take_in(desk.session.tables, _looked(desk), asked.names))
    )
    return _json(_DONE)


def _looked(desk: Desk, build: int | None = None) -> Looked:
    """What the last good build has seen; ``build``: the one that the user saw, which has to be that."""
    if desk.built is None:
        raise JobError("page", "nothing is built yet", remedy="wait for the first program")
    if build not in (None, desk.built.number):
        raise JobError("page", "the picture is of an older program", remedy="wait for the new one")
    return desk.built.looked


async def _undo(desk: Desk, _request: Request) -> Response:
    desk.become(steps.undo(desk.session))
    return _json(_DONE)


async def _redo(desk: Desk, _request: Request) -> Response:
    desk.become(steps.redo(desk.session))
    return _json(_DONE)


async def _build(desk: Desk, _request: Request) -> Response:
    desk.ask()
    return _json(_DONE)


async def _stop(desk: Desk, _request: Request) -> Response:
    desk.stop()
    return _json(_DONE)


async def _propose(desk: Desk, _request: Request) -> Response:
    desk.ask(propose=True)
    return _json(_DONE)


async def _save(desk: Desk, request: Request) -> Response:
    order = msgspec.json.decode(await request.body(), type=_Save)
    return _json({"written": [str(path) for path in await desk.save(order.replace)]})


async def _file(desk: Desk, request: Request) -> Response:
    """The job file was changed by somebody else: whether it counts, or the form."""
    asked = msgspec.json.decode(await request.body(), type=_File)
    (desk.load_job if asked.counts else desk.keep_job)()
    return _json(_DONE)


async def _close(desk: Desk, _request: Request) -> Response:
    desk.closing = True
    return _json(_DONE)
