"""What ``vtr doctor`` checks of who reaches a router: whoever does, and is not asked who he is, drives the robot."""

from __future__ import annotations

import re
import socket
from ipaddress import ip_address

from cli.doctor.check import Check
from common.access.link import client_settings, router_settings
from common.config import RobotConfig
from common.errors import ConfigurationError

_SECURED = ("tls/", "quic/")
_HOST = re.compile(r"^\w+/(?:\[(?P<v6>[^]]+)\]|(?P<host>[^:\[\]]+)):\d+")


def check_access(configuration: RobotConfig) -> Check:
    """Whether machines of the network must show a certificate, to the router and on the link to the fleet's."""
    endpoint, fleet = configuration.bus.endpoint, configuration.bus.fleet
    if _open_to_the_network(endpoint):
        text = f"{endpoint} is open to the network: whoever reaches it may send any command"
        return Check("access control", "fail", text, "listen at 127.0.0.1, or by tls/ with certificates")
    if fleet is not None and _open_to_the_network(fleet):
        text = f"the link to {fleet} carries no certificate: whoever answers there may send any command"
        return Check("access control", "fail", text, "link by tls/, with a certificate of this robot")
    try:
        settings = router_settings(configuration)
        client_settings(configuration, "operator")
    except ConfigurationError as error:
        return Check("access control", "fail", str(error), "docs/security.md shows how it is set up")
    if endpoint.startswith(_SECURED):
        return Check("access control", "ok", f"{endpoint} asks for certificates")
    if "access_control" in settings:
        return Check("access control", "ok", "the router gives each its own rights")
    return Check("access control", "ok", f"only programs of this machine reach {endpoint}")


def _open_to_the_network(endpoint: str) -> bool:
    """Whether other machines reach an endpoint, or are reached at it, without a certificate."""
    if endpoint.startswith((*_SECURED, "unixsock-stream/")):
        return False
    match = _HOST.match(endpoint)
    host = (match["v6"] or match["host"]) if match else ""
    try:
        return not all(ip_address(found[4][0]).is_loopback for found in socket.getaddrinfo(host, None))
    except (OSError, ValueError):
        return True
