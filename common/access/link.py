"""What a session's Zenoh configuration gets of a TOML file: TLS, passwords, access control, and less of the images."""

from __future__ import annotations

import re
import secrets
import ssl
from ipaddress import ip_address
from pathlib import Path
from typing import Any, cast

from common import topics
from common.access import control, rights
from common.access.register import Register
from common.config import RobotConfig, SecurityTable
from common.errors import ConfigurationError
from common.files import open_to_others, write_private

DICTIONARY = "dictionary"
"""In the folder of passwords: all of them, for the router's eyes alone."""

_ENCRYPTED = ("tls", "quic")
_HOST = re.compile(r"^tcp/(?:\[(?P<v6>[^]]+)\]|(?P<host>[^:]+)):\d+")
_HEAVY = (topics.STEREO, topics.CAMERA, topics.LIDAR)


def client_settings(configuration: RobotConfig, process: str) -> dict[str, Any]:
    """For a process that connects to the router at ``[bus] endpoint``.

    Raises:
        ConfigurationError: a certificate or a password that is asked for is missing.
    """
    security, endpoint = configuration.security, configuration.bus.endpoint
    if protocol(endpoint) in _ENCRYPTED:
        return {"transport/link/tls": _tls(configuration, _asked_for(security, endpoint), connects=True)}
    if security is None or security.users is None:
        return {}
    password = _read_secret(configuration.beside(security.users) / process, f"the password of {process}")
    return {"transport/auth/usrpwd": {"user": process, "password": password.strip()}}


def router_settings(configuration: RobotConfig) -> dict[str, Any]:
    """For the router of a robot, or of the fleet.

    Raises:
        ConfigurationError: a certificate, the register or the passwords are missing.
    """
    security, bus = configuration.security, configuration.bus
    settings: dict[str, Any] = {}
    uplink = None if bus.fleet is None else protocol(bus.fleet)
    if bus.fleet is not None and uplink in _ENCRYPTED:
        _asked_for(security, bus.fleet)
        settings["downsampling"] = [downsampling(uplink, bus.fleet_frames_hz)]
    if security is None:
        return settings
    _check_doors(configuration, security)
    if security.listen is not None:
        settings["listen/endpoints"] = [bus.endpoint, security.listen]
    if security.ca is not None:
        listens = security.listen is not None
        settings["transport/link/tls"] = _tls(configuration, security, connects=uplink in _ENCRYPTED, listens=listens)
    if security.users is not None:
        settings["transport/auth/usrpwd"] = {"dictionary_file": str(_dictionary(configuration, security.users))}
    settings["access_control"] = control.access_control(_subjects(configuration, security, uplink))
    return settings


def downsampling(uplink: str, hertz: float) -> dict[str, Any]:
    """Images and scans at most so often on their way to the fleet; a rate of 0 keeps them all on the robot."""
    return {
        "id": "frames to the fleet",
        "messages": ["put"],
        "flows": ["egress"],
        "link_protocols": [uplink],
        "rules": [{"key_expr": topic.at(rights.ANY, rights.ANY), "freq": hertz} for topic in _HEAVY],
    }


def make_passwords(folder: Path) -> list[str]:
    """A password for each process of a robot, each in a file of its own; who has one keeps it. Returns the names.

    Raises:
        OSError: the folder cannot be written to.
    """
    lines = []
    for process in rights.processes():
        path = folder / process
        if not path.exists():
            write_private(path, secrets.token_urlsafe(24) + "\n")
        lines.append(f"{process}:{path.read_text(encoding='utf-8').strip()}")
    write_private(folder / DICTIONARY, "\n".join(lines) + "\n")
    return list(rights.processes())


def protocol(endpoint: str) -> str:
    """The protocol of a Zenoh endpoint."""
    return endpoint.partition("/")[0]


def _subjects(configuration: RobotConfig, security: SecurityTable, uplink: str | None) -> list[control.Subject]:
    local = protocol(configuration.bus.endpoint)
    if configuration.of_fleet:
        remote = "tls" if security.listen is None else protocol(security.listen)
        register = Register() if security.members is None else Register.read(configuration.beside(security.members))
        return control.at_server(local, remote, register.common_names())
    return control.at_robot(configuration.robot.name, local, uplink, passwords=security.users is not None)


def _check_doors(configuration: RobotConfig, security: SecurityTable) -> None:
    """Refuses addresses at which a stranger would be taken for one of this machine's processes, or for the fleet."""
    endpoint, fleet = configuration.bus.endpoint, configuration.bus.fleet
    if protocol(endpoint) in _ENCRYPTED:
        raise ConfigurationError(
            f"{endpoint} in [bus] is for this machine's own processes: write it as tcp/127.0.0.1:7447, say; "
            "a fleet's router lets others in at 'listen' in [security]"
        )
    if security.users is None and not _of_this_machine(endpoint):
        raise ConfigurationError(f"{endpoint} in [bus] asks nobody who he is: with [security], keep it on 127.0.0.1")
    if fleet is not None and protocol(fleet) not in _ENCRYPTED:
        raise ConfigurationError(f"the link to {fleet} is not encrypted, as [security] needs it: write it as tls/")


def _of_this_machine(endpoint: str) -> bool:
    match = _HOST.match(endpoint)
    if match is None:
        return protocol(endpoint) == "unixsock-stream"
    host = match["v6"] or match["host"]
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _asked_for(security: SecurityTable | None, endpoint: str) -> SecurityTable:
    if security is None or security.ca is None:
        raise ConfigurationError(
            f"{endpoint} is encrypted: name 'ca', 'certificate' and 'key' in [security]; vtr keys issues them"
        )
    return security


def _tls(
    configuration: RobotConfig, security: SecurityTable, *, connects: bool, listens: bool = False
) -> dict[str, Any]:
    """Zenoh's ``transport/link/tls``: each end shows its certificate, and a link ends when one of them expires."""
    ca, certificate, key = (
        configuration.beside(cast("Path", path)) for path in (security.ca, security.certificate, security.key)
    )
    for path in (ca, certificate):
        if not path.is_file():
            raise ConfigurationError(f"there is no certificate {path}: vtr keys issues them")
    _read_secret(key, "the private key")
    _check_pair(certificate, key)
    settings: dict[str, Any] = {
        "root_ca_certificate": str(ca),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    if connects:
        settings |= {"connect_certificate": str(certificate), "connect_private_key": str(key)}
    if listens:
        settings |= {"listen_certificate": str(certificate), "listen_private_key": str(key)}
    return settings


def _check_pair(certificate: Path, key: Path) -> None:
    """Refuses what Zenoh would say little of, as while one of the two was copied and the other not yet."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, ValueError):
        raise ConfigurationError(f"{certificate} and {key} are no certificate and its key: copy both anew") from None


def _dictionary(configuration: RobotConfig, users: Path) -> Path:
    path = configuration.beside(users) / DICTIONARY
    _read_secret(path, "the passwords of this robot's processes")
    return path


def _read_secret(path: Path, what: str) -> str:
    try:
        text = path.read_text(encoding="utf-8")
        others = open_to_others(path)
    except OSError as error:
        raise ConfigurationError(f"cannot read {what}, {path}: {error.strerror}; vtr keys makes it") from None
    if others:
        raise ConfigurationError(f"others may read {what}, {path}: chmod 600 it")
    return text
