"""Access control: view and control tokens, allowed hosts and origins.

Three dangers, three checks, all before a route is reached:

    a stranger on the network      a token is needed when the server listens beyond loopback, when the request did not
                                   come from this machine, or when a proxy forwarded it
    a foreign page in the          Origin must be this server (or listed), for everything that changes something and for
    visitor's browser              every WebSocket; bodies are JSON, which no form and no "simple" request can send.
                                   Requests of its images and scripts are refused too, as they could start a viewer
    a foreign name that resolves   Host must be an address, a name of this machine, or listed, for everything but the
    to this machine (rebinding)    page's own files

A view token can read, a control token can also change things. Some requests are POST only because they carry values
(the preview of a setting, an analysis): they change nothing, and a view token may send them
(server/access/route_rules.py). At a fleet server, the same holds for requests to a robot below /robots/NAME; the robot
compares them with its own rules again (extensions/fleet/tunnel/http_tunnel_robot.py).

Wrong tokens are rate-limited: server/access/login_throttle.py explains how, and why a valid token is not locked out.

A token is sent as `Authorization: Bearer …`, as `?token=…`, or as the cookie that `GET /?token=…` sets before it
redirects to the bare address, so that it does not stay in the address bar, in the history or in a log. Loopback without
a proxy needs none: any client that can open that port runs on this machine.

The page's own files and `/healthz` are open: they contain no device data.
"""

from __future__ import annotations

import hmac
import ipaddress
import json
import logging
import math
import platform
import re
import secrets
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Any, Literal, Protocol
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from imuscope.server.access.login_throttle import MIN_UNGUESSABLE_CHARS, LoginThrottle
from imuscope.server.access.route_rules import FILES, SAFE_METHODS, RouteRules
from imuscope.server.access.security_headers import WEBHOOK_HEADER, with_defaults
from imuscope.server.errors import DomainError, status_of
from imuscope.server.settings.config import Config, is_loopback

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

log = logging.getLogger("imuscope.auth")

Role = Literal["view", "control"]
FORWARDING = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip", "via")
MAX_BODY = 1024 * 1024
ON_ROBOT = re.compile(r"/robots/[^/]+(/(?:api|ws)(?:/.*)?)\Z", re.DOTALL)
COOKIE_AGE_S = 90 * 24 * 3600


class RefusedError(DomainError):
    """A refused request; it may be repeated after `retry_s` (0: no time given)."""

    def __init__(self, kind: str, message: str, hint: str = "", retry_s: int = 0) -> None:
        super().__init__(kind, message, hint)
        self.retry_s = retry_s


class PartialRights(Protocol):
    """Tokens of users who see everything and command a part of it (server/extensions/fleet/model/operators.py)."""

    def holder(self, token: str) -> str:
        """The name of the user with this token; empty if there is none."""
        ...

    def may_command(self, token: str, path: str) -> bool:
        """Whether that user may command what the path of a request names."""
        ...


class Access:
    """The rules, independent of any framework: headers in, a role or a refusal out.

    Args:
        config: addresses, tokens and allow-lists. Missing tokens are generated when the server listens beyond loopback.
        failures: counter of wrong tokens.

    Attributes:
        operators: further tokens; None for none.
        routes: which paths need a token.
    """

    def __init__(self, config: Config, failures: LoginThrottle | None = None) -> None:
        self.config = config
        self.operators: PartialRights | None = None
        self.routes = RouteRules()
        self._failures = LoginThrottle() if failures is None else failures
        needed = not config.is_loopback
        self.control_token = config.control_token or (secrets.token_urlsafe(18) if needed else "")
        self.view_token = config.view_token or (secrets.token_urlsafe(18) if needed else "")
        names = {"localhost", config.host, platform.node(), platform.node().partition(".")[0] + ".local"}
        self._hosts = {name.lower() for name in (*names, *config.allowed_hosts) if name}
        self._origins = {origin.lower().rstrip("/") for origin in config.allowed_origins}

    def rules(self) -> dict[str, Any]:
        """The settings that give the same rules in another process, generated tokens included."""
        names = ("host", "port", "allowed_hosts", "allowed_origins")
        made = {"view_token": self.view_token, "control_token": self.control_token}
        return {**{name: getattr(self.config, name) for name in names}, **made}

    def role_of(self, token: str) -> Role | None:
        """Rights of a token. Compared in constant time."""
        granted: Role | None = None
        for role, right in (("view", self.view_token), ("control", self.control_token)):
            if right and hmac.compare_digest(token.encode(), right.encode()):
                granted = "control" if role == "control" else "view"
        if granted is None and self.operators is not None and self.operators.holder(token):
            granted = "view"
        return granted

    def operator_of(self, headers: Mapping[str, str], query_token: str) -> str:
        """Name of the operator whose token a request has; empty if it has none of them."""
        return self.operators.holder(self._token(headers, query_token)) if self.operators is not None else ""

    def resolve_role(self, token: str, client: str, headers: Mapping[str, str]) -> Role | None:
        """Rights of a token; where a token is needed, an invalid one is counted.

        Raises:
            RefusedError: too many wrong tokens came from this client; this one was not checked.
        """
        role = self.role_of(token)
        if self.is_open(client, headers) or (role is not None and len(token) >= MIN_UNGUESSABLE_CHARS):
            return role
        wait = math.ceil(self._failures.wait_s(client))
        if wait:
            message = "Too many wrong tokens came from this address."
            raise RefusedError("too-many-tokens", message, f"Try again in {wait} s.", wait)
        if role is None:
            self._failures.count(client)
        return role

    def check(
        self,
        path: str,
        method: str,
        headers: Mapping[str, str],
        *,
        client: str,
        query_token: str = "",
        websocket: bool = False,
        place: str = "",
    ) -> Role:
        """The role of a request to a protected path.

        Args:
            path: at the robot, if the request is passed on to one.
            place: the path of the request itself, which names that robot; default: none is named.
            method: upper case; "GET" for a WebSocket.
            headers: names in lower case.
            client: address of the peer, "" when unknown.

        Raises:
            RefusedError: with the reason and what to do.
        """
        changes = method not in SAFE_METHODS
        self._check_host(headers.get("host", ""))
        if changes or websocket:
            is_of_other = headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
            self._check_origin(headers.get("origin", "null" if is_of_other else None), headers.get("host", ""))
        else:
            self._check_site(headers)
        role = self._check_token(headers, client, query_token)
        if role == "view" and place and self.operators is not None:
            role = "control" if self.operators.may_command(self._token(headers, query_token), place) else "view"
        if changes:
            _check_body(headers, is_file=(method, path) in FILES)
            if role != "control" and self.routes.is_command(method, path):
                raise self._view_only(headers, query_token)
        return role

    def _view_only(self, headers: Mapping[str, str], query_token: str) -> RefusedError:
        hint = "Open the page with a control token."
        name = self.operator_of(headers, query_token)
        if name:
            return RefusedError("view-only", f"The token of {name} does not command this.", f"{hint} Or add the group.")
        return RefusedError("view-only", "This token is view-only.", hint)

    def is_open(self, client: str, headers: Mapping[str, str]) -> bool:
        """Whether the request needs no token: the server listens on loopback only; the client is on this machine."""
        return self.config.is_loopback and is_loopback(client or "127.0.0.1") and not _is_forwarded(headers)

    def _check_host(self, host: str) -> None:
        name = _host_name(host)
        if name in self._hosts or _is_address(name):
            return
        hint = "Use the address, or add the name to allowed_hosts in the configuration file."
        raise RefusedError("bad-host", f"This server is not called {name!r:.80}.", hint)

    def _check_origin(self, origin: str | None, host: str) -> None:
        if origin is None:
            return  # not a browser: browsers always send Origin with a WebSocket or a change
        parts = urlsplit(origin.lower())
        if origin.lower() in self._origins or (parts.scheme in ("http", "https") and parts.netloc == host.lower()):
            return
        hint = "If it should be, add it to allowed_origins in the configuration file."
        raise RefusedError("bad-origin", f"The page {origin!r:.120} may not use this server.", hint)

    def _check_site(self, headers: Mapping[str, str]) -> None:
        """Allow top-level navigation from another page, but no embedding unless that page is listed. Browsers send
        these headers to trusted addresses (loopback and TLS) only; elsewhere a token is needed, which they do not send
        across sites.
        """
        same_site = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        is_navigation = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")
        if same_site or is_navigation:
            return
        parts = urlsplit(headers.get("referer", ""))
        self._check_origin(headers.get("origin") or f"{parts.scheme}://{parts.netloc}", headers.get("host", ""))

    def _token(self, headers: Mapping[str, str], query_token: str) -> str:
        return _bearer(headers) or query_token or self._cookie(headers)

    def _check_token(self, headers: Mapping[str, str], client: str, query_token: str) -> Role:
        token = self._token(headers, query_token)
        role = self.resolve_role(token, client, headers) if token else None
        if role is not None:
            return role
        if self.is_open(client, headers):
            return "control"
        if token:
            raise RefusedError("bad-token", "This token is not valid.", "Use the address that the server printed.")
        if _is_forwarded(headers) and not self.control_token:
            hint = "Set control_token (and view_token) in the configuration file before putting a proxy in front."
            raise RefusedError("no-token", "A request through a proxy needs a token, and this server has none.", hint)
        hint = "Open the address that the server printed when it started; it carries the token."
        raise RefusedError("no-token", "This server asks for a token.", hint)

    @property
    def cookie_name(self) -> str:
        """Name with the port: cookies ignore ports, and two servers on one host must not overwrite each other's."""
        return f"imuscope_{self.config.port}"

    def _cookie(self, headers: Mapping[str, str]) -> str:
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(self.cookie_name)
        except CookieError:
            return ""
        return morsel.value if morsel is not None else ""


def _check_body(headers: Mapping[str, str], *, is_file: bool) -> None:
    """Refuse a body without a length; except for a file, also one that is not JSON or is larger than `MAX_BODY`."""
    length, in_pieces = headers.get("content-length", "0"), "transfer-encoding" in headers
    if (length != "0" or in_pieces) and not is_file and content_type(headers) != "application/json":
        raise RefusedError("not-json", "A body must be JSON.", "Send it with Content-Type: application/json.")
    if in_pieces:
        raise RefusedError("no-length", "A body needs a length.", "Send it with Content-Length.")
    if not is_file and (not length.isascii() or not length.isdigit() or int(length) > MAX_BODY):
        raise RefusedError("too-large", f"A body may have at most {MAX_BODY} bytes.", "Send it in smaller parts.")


def content_type(headers: Mapping[str, str]) -> str:
    """The media type of a body, in lower case and without parameters; "" if it is not given."""
    return headers.get("content-type", "").partition(";")[0].strip().lower()


def _bearer(headers: Mapping[str, str]) -> str:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def _is_forwarded(headers: Mapping[str, str]) -> bool:
    return any(name in headers for name in FORWARDING)


def _host_name(host: str) -> str:
    """robot.local:8080 → robot.local; [::1]:8080 → ::1."""
    if host.startswith("["):
        name, _, after = host[1:].partition("]")
        return name.lower() if re.fullmatch(r"(:\d+)?", after) else host.lower()
    return host.partition(":")[0].lower().rstrip(".")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def path_on_robot(path: str) -> str:
    """The path at the robot of a request to its fleet server: /robots/otter-7/api/devices → /api/devices."""
    match = ON_ROBOT.match(path)
    return match[1] if match else path


class Guard:
    """The rules as ASGI middleware, around everything."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        send = with_defaults(send)
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        path, method = path_on_robot(scope["path"]), scope.get("method", "GET")
        client = (scope.get("client") or ("", 0))[0]
        try:
            if WEBHOOK_HEADER in headers:
                hint = "Give the alarm another address."
                raise RefusedError("own-webhook", "Webhooks of imuscope may not be posted to imuscope.", hint)
            if self._access.routes.is_protected(path):
                socket = scope["type"] == "websocket"
                place = scope["path"]
                role = self._access.check(
                    path, method, headers, client=client, query_token=token, websocket=socket, place=place
                )
                scope.setdefault("state", {}).update(role=role, operator=self._access.operator_of(headers, token))
            elif (
                token
                and scope["type"] == "http"
                and method == "GET"
                and self._access.resolve_role(token, client, headers)
            ):
                await self._store(scope, send, token)
                return
        except RefusedError as refusal:
            _log_refusal(scope, refusal)
            await refuse(scope, receive, send, refusal, refusal.retry_s)
            return
        await self.app(scope, receive, send)

    async def _store(self, scope: Scope, send: Send, token: str) -> None:
        """Put the token of the printed address into a cookie and go to the address without it."""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        del query["token"]
        rest = "?" + urlencode(query, doseq=True) if query else ""
        # Relative, as a proxy may have put the server below a path; a line break would end the response header.
        path = "./" + quote(scope["path"].rpartition("/")[2])
        over_tls = scope.get("scheme") == "https" or (b"x-forwarded-proto", b"https") in scope["headers"]
        secure = "; Secure" if over_tls else ""
        attributes = f"HttpOnly; SameSite=Strict; Max-Age={COOKIE_AGE_S}{secure}"
        if scope["path"] != "/":
            attributes = f"Path=/; {attributes}"  # else the path of a proxy is the default
        cookie = f"{self._access.cookie_name}={token}; {attributes}"
        headers = [
            (b"location", (path + rest).encode("ascii")),
            (b"set-cookie", cookie.encode("latin-1")),
            (b"cache-control", b"no-store"),
            (b"referrer-policy", b"no-referrer"),
            (b"content-length", b"0"),
        ]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


def _log_refusal(scope: Scope, refusal: RefusedError) -> None:
    """Log client, path and reason of a refusal. Never the query, which may contain a token."""
    peer, way = (scope.get("client") or ("", 0))[0], scope.get("method", "WebSocket")
    text = f"Refused {way} {scope['path'][:200]} from {peer or 'an unknown peer'}: {refusal.message}"
    data = {"kind": refusal.kind, "status": status_of(refusal.kind), "peer": peer, "path": scope["path"][:200]}
    log.warning("%s", text, extra={"event": "refused", "data": data, "often": ("refused", refusal.kind, peer)})


async def refuse(scope: Scope, receive: Receive, send: Send, why: DomainError, retry_s: int = 0) -> None:
    """Answer with the common error shape, also before a WebSocket is accepted."""
    status = status_of(why.kind)
    body = json.dumps({"kind": why.kind, "message": why.message, "hint": why.hint}).encode()
    prefix = "websocket." if scope["type"] == "websocket" else ""
    if prefix:
        await receive()  # websocket.connect
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008, "reason": why.message[:120]})
            return
    headers = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
    ]
    if status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    if retry_s:
        headers.append((b"retry-after", str(retry_s).encode()))
    await send({"type": prefix + "http.response.start", "status": status, "headers": headers})
    await send({"type": prefix + "http.response.body", "body": body})
