"""What ``vtr doctor`` checks of certificates: those that the configuration names, and what the storage shows."""

from __future__ import annotations

import socket
import ssl
import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cryptography import x509

from cli.doctor.check import Check
from cli.doctor.storage import storage_of
from common.config import RobotConfig

_SOON = timedelta(days=21)
_KEYS = {"certificate", "ca"}
_CONNECT_S = 2.0
_RENEW = "renew it, and see that the clock is right"


def check_certificates(configuration: RobotConfig, now: datetime | None = None) -> Check:
    """Whether every certificate is there, valid now, and for some weeks yet."""
    now = now or datetime.now(UTC)
    checks = [_judge(where, found, now) for where, found in _certificates(configuration)]
    if not checks:
        return Check("certificates", "ok", "none is used")
    worst = min(checks, key=lambda check: ("fail", "warn", "ok").index(check.verdict))
    if worst.verdict != "ok":
        return worst
    return Check("certificates", "ok", "; ".join(check.text for check in checks))


def _certificates(configuration: RobotConfig) -> Iterator[tuple[str, x509.Certificate | str]]:
    """Each certificate with where it is from, or why it cannot be read."""
    base = configuration.path.absolute().parent
    for path in dict.fromkeys(_named(tomllib.loads(configuration.path.read_text(encoding="utf-8")))):
        try:
            for certificate in x509.load_pem_x509_certificates((base / Path(path).expanduser()).read_bytes()):
                yield path, certificate
        except OSError as error:
            yield path, f"cannot be read: {error.strerror}"
        except ValueError:
            yield path, "is no certificate in PEM"
    storage = storage_of(configuration)
    if storage is not None and storage.secure and (shown := _shown(storage.endpoint)) is not None:
        yield storage.endpoint, shown


def _named(table: dict[str, Any]) -> Iterator[str]:
    """The files that are named as certificates anywhere in a configuration."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _named(value)
        elif key in _KEYS and isinstance(value, str):
            yield value


def _shown(endpoint: str) -> x509.Certificate | None:
    """The certificate that a server shows, valid or not; None where it shows none."""
    address = urlsplit(endpoint)
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # it is looked at, and not trusted
    try:
        with (
            socket.create_connection((address.hostname or "", address.port or 443), _CONNECT_S) as plain,
            context.wrap_socket(plain, server_hostname=address.hostname) as secured,
        ):
            shown = secured.getpeercert(binary_form=True)
    except OSError:
        return None  # check_storage says so
    return None if shown is None else x509.load_der_x509_certificate(shown)


def _judge(where: str, found: x509.Certificate | str, now: datetime) -> Check:
    if isinstance(found, str):
        return Check("certificates", "fail", f"{where} {found}", "name the right file, readable for this user")
    begins, ends = found.not_valid_before_utc, found.not_valid_after_utc
    if now < begins:
        return Check("certificates", "fail", f"{where} is not valid before {begins:%Y-%m-%d %H:%M} UTC", _RENEW)
    if now > ends:
        return Check("certificates", "fail", f"{where} expired on {ends:%Y-%m-%d}", _RENEW)
    if ends - now < _SOON:
        return Check("certificates", "warn", f"{where} expires on {ends:%Y-%m-%d}", "renew it in time")
    return Check("certificates", "ok", f"{where} is valid until {ends:%Y-%m-%d}")
