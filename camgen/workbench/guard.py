"""Who may talk to the workbench: whoever has the token of its address, from a page of its own, on this machine.

Another page in the same browser can send requests to any port of this machine, and a name that somebody else owns can
point to 127.0.0.1: so ``Host`` and ``Origin`` are looked at as well (DNS rebinding, cross-site requests).
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

#: The most that a request may send, bytes; a job with thousands of ids has some 100 000.
MOST_BYTES = 2_000_000
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

#: The shell runs its own scripts and styles, talks to where it comes from, and is framed by nobody.
SHELL_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; frame-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: The preview has its own policy, by the hashes of its scripts; only the shell may frame it.
PAGE_POLICY = "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
#: A drawing: its own style and the pictures in it.
PICTURE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


def make_token() -> str:
    """A new secret for an address: 256 bits."""
    return secrets.token_urlsafe(32)


def guard(app: App, token: str, port: int) -> App:
    """``app`` for those who may talk to it; what it answers cannot be read by, framed in or kept by anything else."""

    async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await app(scope, receive, send)
            return
        fault = why_not(scope, token, port)
        if fault:
            await _refuse(send, *fault)
            return
        await app(scope, _bounded(receive), _with_headers(send))

    return guarded


def why_not(scope: Scope, token: str, port: int) -> tuple[int, str] | None:
    """Status and reason where a request is refused, None where it is answered."""
    headers = [
        (name.decode("latin-1").lower(), value.decode("latin-1"))
        for name, value in scope["headers"]
    ]
    said = dict(headers)
    hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
    if [value for name, value in headers if name == "host"] not in [[host] for host in hosts]:
        return 421, "this address is not the workbench's"
    first = scope["path"].split("/")[1] if scope["path"].startswith("/") else ""
    if not secrets.compare_digest(first.encode(), token.encode()):
        return 404, "no such page; the address stands in the terminal where camgen open runs"
    own = f"http://{said['host']}"
    changes = scope["method"] not in ("GET", "HEAD")
    if said.get("origin", own if not changes else "") != own:
        return 403, "only the workbench's own pages may ask this"
    if said.get("sec-fetch-site", "same-origin") not in ("same-origin", "none") and not _is_visit(
        scope, said
    ):
        return 403, "only the workbench's own pages may ask this"
    if changes and said.get("content-type", "").partition(";")[0].strip() != "application/json":
        return 415, "send JSON"
    length = said.get("content-length", "0")
    if not length.isdigit() or int(length) > MOST_BYTES:
        return 413, f"more than {MOST_BYTES} bytes"
    return None


def _is_visit(scope: Scope, said: MutableMapping[str, str] | dict[str, str]) -> bool:
    """Whether a user goes to the page, from wherever the address stands."""
    return (
        scope["method"] == "GET"
        and said.get("sec-fetch-mode") == "navigate"
        and said.get("sec-fetch-dest") == "document"
    )


def _bounded(receive: Receive) -> Receive:
    """What is sent without a length is bounded too."""
    got = 0

    async def bounded() -> MutableMapping[str, Any]:
        nonlocal got
        message = await receive()
        got += len(message.get("body", b""))
        return message if got <= MOST_BYTES else {"type": "http.disconnect"}

    return bounded


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *_HEADERS]}
        await send(message)

    return sending


async def _refuse(send: Send, status: int, why: str) -> None:
    body = f"{why}\n".encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        *_HEADERS,
    ]
    headers.append((b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
