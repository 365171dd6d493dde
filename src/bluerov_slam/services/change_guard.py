"""Who may change something: a page of the vehicle itself, or a program that knows the token."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Callable, Collection
from urllib.parse import urlsplit


class ChangeGuard:
    """Judges the Origin of calls that change something, so that a foreign web page in the pilot's browser cannot.

    `trusted_origins` and `token` are asked each time, because both are settings.
    """

    def __init__(self, trusted_origins: Callable[[], Collection[str]], token: Callable[[], str]) -> None:
        self._trusted_origins = trusted_origins
        self._token = token

    def refusal(self, origin: str | None, host: str | None, authorization: str | None) -> str | None:
        """Why the call is refused and how to cure it, or None when it may go on."""
        if origin is None:
            return None if self._knows_token(authorization) else _HOW_PROGRAMS_MAY
        name = _host_name(origin)
        if name and (name == _host_name(f"//{host}") or _is_local(name) or self._is_trusted(origin, name)):
            return None
        return (
            f"pages of {origin} may not change anything here; add it to http.trusted_origins, "
            "or open the page by the vehicle's address"
        )

    def _knows_token(self, authorization: str | None) -> bool:
        token = self._token()
        return bool(token) and is_bearer(authorization, token)

    def _is_trusted(self, origin: str, name: str) -> bool:
        trusted = {entry.rstrip("/").lower() for entry in self._trusted_origins()}
        return origin.lower() in trusted or name in trusted


def is_bearer(authorization: str | None, token: str) -> bool:
    """Whether an Authorization header carries this token; takes as long whatever it carries."""
    given = (authorization or "").removeprefix("Bearer ")
    # A header's bytes that are no UTF-8 arrive as lone surrogates.
    return hmac.compare_digest(given.encode(errors="surrogatepass"), token.encode())


_HOW_PROGRAMS_MAY = (
    "a program that changes something needs the header 'Authorization: Bearer <http.token>'; "
    "set http.token in the configuration file or as BLUEROV_SLAM_HTTP__TOKEN"
)


def _host_name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _is_local(name: str) -> bool:
    if name.endswith(".local"):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
