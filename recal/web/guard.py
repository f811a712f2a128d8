"""What every request must pass and every answer carries: host, origin, size, security headers.
Plain ASGI.

Host against DNS rebinding; Origin and Sec-Fetch-Site against forms of other sites; a small body
read whole beforehand.
"""

import asyncio
import ipaddress
import re
from collections.abc import Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from recal.web.settings import LOOPBACK_NAMES, ServeSettings, is_loopback

Refuse = Callable[[int, str], tuple[int, list[tuple[bytes, bytes]], bytes]]

# bytes of a form (docs/serve.md): a reason of 4,000 letters of two bytes has 24,000 when
# percent-encoded
MAX_BODY = 32_768
# A Host, whole: a name or an address, IPv6 in brackets, and perhaps a port (RFC 9110, 7.2).
HOST = re.compile(
    r"(?:(?P<name>[0-9A-Za-z._-]+)|\[(?P<ipv6>[0-9A-Fa-f:.]+)\])(?::(?P<port>[0-9]{1,5}))?"
)
MAX_PORT = 65_535  # 2^16 - 1
BODY_WAIT_S = 10.0
BODY = "recal.body"  # where the routes find it in the scope
FORM = "application/x-www-form-urlencoded"
HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    # with no-referrer, browsers would send forms with `Origin: null`
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "content-security-policy": "default-src 'none'; frame-ancestors 'none'",
}


class Refused(Exception):
    """A request that goes no further: status and one line for people."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(line)
        self.status, self.line = status, line


class Guard:
    """Wraps the application; `page(status, line)` makes the answer to a refused request."""

    def __init__(self, app: ASGIApp, settings: ServeSettings, page: Refuse) -> None:
        self._app, self._settings, self._page = app, settings, page

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        send = self._with_headers(send)
        try:
            headers = _headers(scope)
            self._check_host(headers)
            if scope["method"] == "POST":
                check_origin(headers)
                scope[BODY] = await asyncio.wait_for(_body(headers, receive), BODY_WAIT_S)
            elif scope["method"] != "GET":
                raise Refused(405, "Only GET and POST are served.")
        except TimeoutError:
            await self._refuse(send, Refused(408, "The form did not arrive in time."))
        except Refused as refused:
            await self._refuse(send, refused)
        else:
            await self._app(scope, _replayed(scope.get(BODY, b""), receive), send)

    async def _refuse(self, send: Send, refused: Refused) -> None:
        status, headers, body = self._page(refused.status, refused.line)
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    def _with_headers(self, send: Send) -> Send:
        https = {"strict-transport-security": "max-age=31536000"} if self._settings.https else {}

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                extra = [
                    (k.encode(), v.encode())
                    for k, v in {**HEADERS, **https}.items()
                    if k.encode() not in given
                ]
                message = {**message, "headers": [*message["headers"], *extra]}
            await send(message)

        return sending

    def _check_host(self, headers: dict[str, list[str]]) -> None:
        given = headers.get("host", [])
        if len(given) != 1 or not allowed_host(given[0], self._settings):
            raise Refused(
                421,
                "This address is not served here. The operator may allow a name with --allow-host.",
            )


def allowed_host(host: str, settings: ServeSettings) -> bool:
    """May a browser ask under this Host? An IP address cannot be rebound; names must be known. The
    port does not count.
    """
    found = HOST.fullmatch(host)
    if found is None or int(found["port"] or 0) > MAX_PORT:
        return False
    name = (found["name"] or found["ipv6"]).lower()
    address = _address(name)
    if found["ipv6"] and (address is None or address.version != 6):
        return False
    if name in settings.hosts or name == settings.host.lower():
        return True
    if address is None:
        return name in LOOPBACK_NAMES
    return address.is_loopback or not is_loopback(settings.host)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def check_origin(headers: dict[str, list[str]]) -> None:
    """Refused unless a browser says that the form came from this very site."""
    site, origin, host = (headers.get(name, []) for name in ("sec-fetch-site", "origin", "host"))
    own = [f"http://{host[0]}".lower(), f"https://{host[0]}".lower()]
    wrong = (site and site != ["same-origin"]) or (
        origin and (len(origin) > 1 or origin[0].lower() not in own)
    )
    if wrong or not (site or origin):
        raise Refused(
            403,
            "The form did not come from this page. Open the page again and send the form from"
            " there.",
        )


async def _body(headers: dict[str, list[str]], receive: Receive) -> bytes:
    """The whole body of a form; Refused where it is none or too large."""
    kind = headers.get("content-type", [""])[0].partition(";")[0].strip().lower()
    if kind != FORM:
        raise Refused(415, f"Needed a form ({FORM}).")
    length = headers.get("content-length", ["0"])[0]
    body, more = b"", True
    while more and len(body) <= MAX_BODY and length.isdecimal() and int(length) <= MAX_BODY:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Refused(400, "The form was cut off.")
        body, more = body + message.get("body", b""), message.get("more_body", False)
    if more or len(body) > MAX_BODY:
        raise Refused(413, f"The form is larger than {MAX_BODY} bytes.")
    return body


def _replayed(body: bytes, receive: Receive) -> Receive:
    """`receive` for the application, which finds the body that was read already."""
    given = False

    async def replaying() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replaying


def _headers(scope: Scope) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found
