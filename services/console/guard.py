"""Who may use the console: hosts, origins, the token, and the patience with those who guess it."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import stat
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from common.errors import ConfigurationError

_SHORTEST_TOKEN = 16
_ADDRESSES_KEPT = 4096
_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 30.0
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


def read_token(path: Path) -> str:
    """The token in a file.

    Raises:
        ConfigurationError: the file cannot be read, others may read it, or its token is too short to be one.
    """
    how = f"make one with: (umask 077; openssl rand -hex 32 > {path})"
    try:
        mode = path.stat().st_mode
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise ConfigurationError(f"cannot read the console's token {path}: {reason}; {how}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigurationError(f"others may read the console's token {path}: chmod 600 {path}")
    if len(token) < _SHORTEST_TOKEN:
        raise ConfigurationError(f"the console's token in {path} has less than {_SHORTEST_TOKEN} characters; {how}")
    return token


def session_secret(path: Path) -> bytes:
    """The secret that signs sessions, made at the first start: so that pages stay logged in when the console restarts.

    Raises:
        ConfigurationError: it can neither be read nor made.
    """
    try:
        if path.is_file() and len(secret := path.read_bytes()) == 32:
            return secret
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        secret = secrets.token_bytes(32)
        path.touch(mode=0o600)
        path.write_bytes(secret)
    except OSError as error:
        raise ConfigurationError(f"cannot keep the console's secret in {path}: {error.strerror}") from None
    return secret


@dataclass(frozen=True, slots=True)
class Guard:
    """The rules of access.

    Attributes:
        token: what a browser must know, None where this machine alone reaches the console.
        secret: signs the session of a browser that knew it.
        hosts: names under which the console is known, beside those of the loopback; only without a token.
        origins: pages of other origins that may use it.
    """

    token: str | None
    secret: bytes
    hosts: frozenset[str] = frozenset()
    origins: frozenset[str] = frozenset()

    def allows_host(self, host: str) -> bool:
        """Whether a request names this console.

        Without a token a foreign name means that some page has led the browser here by its own DNS. With one it means
        nothing: the session belongs to the name that it was begun under.
        """
        if self.token is not None:
            return True
        name = urlsplit(f"//{host}").hostname or ""
        known = self.hosts | {urlsplit(origin).hostname for origin in self.origins}
        return name in _LOOPBACK or name in known

    def allows_origin(self, origin: str | None, host: str) -> bool:
        """Whether a page of an origin may use the console that it calls ``host``; programs have no origin."""
        if origin is None or origin in self.origins:
            return True
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()

    def knows_token(self, token: str) -> bool:
        """Whether this is the token."""
        return self.token is None or hmac.compare_digest(token.encode(), self.token.encode())

    def session(self) -> str:
        """What a browser that knew the token keeps; it ends when the token changes."""
        return hmac.new(self.secret, (self.token or "").encode(), hashlib.sha256).hexdigest()

    def knows_session(self, session: str) -> bool:
        """Whether a browser has a session."""
        return self.token is None or hmac.compare_digest(session.encode(), self.session().encode())


class Guesses:
    """Slows those who try tokens: after each wrong one an address waits twice as long, up to half a minute."""

    def __init__(self) -> None:
        self._until: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait(self, address: str, now: float) -> float:
        """Seconds that an address has to wait before its next token is looked at; 0: none."""
        _, until = self._until.get(address, (0, now))
        return max(until - now, 0.0)

    def wrong(self, address: str, now: float) -> None:
        """Notes a wrong token."""
        count = self._until.get(address, (0, now))[0] + 1
        self._until[address] = (count, now + min(_FIRST_WAIT_S * 2 ** min(count - 1, 10), _LONGEST_WAIT_S))
        self._until.move_to_end(address)
        if len(self._until) > _ADDRESSES_KEPT:
            self._until.popitem(last=False)

    def right(self, address: str) -> None:
        """Forgets what an address guessed."""
        self._until.pop(address, None)
