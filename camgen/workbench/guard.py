"""Answers only requests that have the workbench's token, from its own pages on this machine.

A foreign page in the same browser can send requests to any port of this machine, and a foreign
host name can point to 127.0.0.1. So `Host` and `Origin` are checked too (DNS rebinding, cross-site
requests).
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

#: Maximum size of a request, bytes. A job with thousands of ids has about 100 000.
MOST_BYTES = 2_000_000
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

#: The shell runs its own scripts and styles, connects to its own server, and cannot be framed.
SHELL_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: The preview has its own policy, by the hashes of its scripts; only the shell may frame it.
PAGE_POLICY = "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
#: A drawing: its own style and the pictures in it.
PICTURE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)
_JSON = "application/json"
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
    """`app`, protected by the checks of this module.

    The headers of its answers forbid other sites to read or frame them, and browsers to store them.
    """

    async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await app(scope, receive, send)
            return
        fault = find_fault(scope, token, port)
        if fault:
            await _refuse(send, *fault)
            return
        await app(scope, _limit_body(receive), _add_headers(send))

    return guarded


def find_fault(scope: Scope, token: str, port: int) -> tuple[int, str] | None:
    """Status and reason of a refused request, None for a valid one."""
    pairs = [
        (name.decode("latin-1").lower(), value.decode("latin-1"))
        for name, value in scope["headers"]
    ]
    headers = dict(pairs)
    hosts = [value for name, value in pairs if name == "host"]
    if hosts not in ([f"127.0.0.1:{port}"], [f"localhost:{port}"]):
        return 421, "this address does not belong to the workbench"
    first = scope["path"].split("/")[1] if scope["path"].startswith("/") else ""
    if not secrets.compare_digest(first.encode(), token.encode()):
        return 404, "no such page; the terminal in which camgen open runs shows the address"
    origin = f"http://{headers['host']}"
    is_change = scope["method"] not in ("GET", "HEAD")
    is_own = headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")
    if headers.get("origin", "" if is_change else origin) != origin or not (
        is_own or _is_visit(scope, headers)
    ):
        return 403, "only pages of the workbench may send this request"
    if is_change and headers.get("content-type", "").partition(";")[0].strip() != _JSON:
        return 415, "send JSON"
    length = headers.get("content-length", "0")
    if not length.isdigit() or int(length) > MOST_BYTES:
        return 413, f"more than {MOST_BYTES} bytes"
    return None


def _is_visit(scope: Scope, headers: dict[str, str]) -> bool:
    """Whether the user opens the page, for example from a link on another site."""
    return (
        scope["method"] == "GET"
        and headers.get("sec-fetch-mode") == "navigate"
        and headers.get("sec-fetch-dest") == "document"
    )


def _limit_body(receive: Receive) -> Receive:
    """Limit the body of a request that states no length."""
    received = 0

    async def limited() -> MutableMapping[str, Any]:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        return message if received <= MOST_BYTES else {"type": "http.disconnect"}

    return limited


def _add_headers(send: Send) -> Send:
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
        (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'"),
    ]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
