"""ROS's names on Zenoh: keys of topics, and the liveliness tokens by which ``rmw_zenoh`` knows its graph.

After ``rmw_zenoh``'s docs/design.md: a topic's key is ``<domain>/<topic>/<type>/<type hash>``, a node's token
``@ros2_lv/<domain>/<session>/<node>/<node>/NN/<enclave>/<namespace>/<node's name>``, and that of an endpoint goes on
with ``<topic>/<type>/<type hash>/<quality of service>``; slashes within a part are ``%``. The bridge's key is the
topic's name alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from services.sensors.ros2.qos import Qos

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_SPACE = "@ros2_lv"
_ENDPOINT_PARTS = 13

Kind = Literal["MP", "MS"]
"""A publisher's token, and a subscription's."""


def check_name(name: str, setting: str) -> None:
    """Refuses what is neither empty nor a ROS name, which has no place in a key either.

    Raises:
        ValueError: letters, digits and underscores between slashes are asked for.
    """
    if name and not _NAME.fullmatch(name):
        raise ValueError(f"`{setting}` is '{name}', which is no ROS name: letters, digits and '_' between slashes.")


def sibling(topic: str, name: str) -> str:
    """The topic of another name beside one, as ``left/camera_info`` beside ``left/image_rect/compressed``."""
    parent = topic.removesuffix("/compressed").rpartition("/")
    return f"{parent[0]}{parent[1]}{name}"


def resolve(name: str, namespace: str) -> str:
    """The absolute name of a topic: with its slash in front."""
    return name if name.startswith("/") else f"{_absolute(namespace).rstrip('/')}/{name}"


def mangle(name: str) -> str:
    """A name as one part of a key."""
    return name.replace("/", "%") or "%"


def dds_type(type_name: str) -> str:
    """The type's name in keys: ``std_msgs::msg::dds_::String_`` for ``std_msgs/msg/String``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(dds: str) -> str:
    """Inverse of :func:`dds_type`."""
    return dds.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def topic_key(domain: int, topic: str, dds: str, type_hash: str) -> str:
    """The key of an absolute topic in ``rmw_zenoh``; type and hash may be ``*``."""
    return f"{domain}/{topic.strip('/')}/{dds}/{type_hash}"


def bridge_key(topic: str) -> str:
    """The key of an absolute topic behind ``zenoh-bridge-ros2dds``."""
    return topic.strip("/")


@dataclass(frozen=True, slots=True)
class Node:
    """A node of the graph: the domain, the Zenoh session that it lives in, its namespace and its name."""

    domain: int
    session: str
    namespace: str
    name: str

    def token(self) -> str:
        """Its liveliness token."""
        return f"{self._part(0)}/NN/{self._name}"

    def endpoint_token(self, number: int, kind: Kind, endpoint: Endpoint) -> str:
        """The token of its endpoint; ``number`` tells those of one session apart."""
        e = endpoint
        return f"{self._part(number)}/{kind}/{self._name}/{mangle(e.topic)}/{e.dds}/{e.type_hash}/{e.qos.encode()}"

    def _part(self, number: int) -> str:
        return f"{_SPACE}/{self.domain}/{self.session}/0/{number}"

    @property
    def _name(self) -> str:
        return f"%/{mangle(_absolute(self.namespace))}/{self.name}"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """What a publisher or a subscription is of."""

    topic: str
    dds: str
    type_hash: str
    qos: Qos


@dataclass(frozen=True, slots=True)
class Told:
    """What a token tells of an endpoint, and the node that has it."""

    kind: str
    node: str
    topic: str
    dds: str
    type_hash: str


def all_tokens(domain: int) -> str:
    """The key expression of all tokens of a domain."""
    return f"{_SPACE}/{domain}/**"


def read_token(key: str) -> Told | None:
    """The endpoint of a token; None where it is a node's, or none at all."""
    parts = key.split("/")
    # Later releases of rmw_zenoh may have more to tell behind.
    if len(parts) < _ENDPOINT_PARTS or parts[0] != _SPACE or parts[5] not in ("MP", "MS"):
        return None
    return Told(parts[5], parts[8], parts[9].replace("%", "/"), parts[10], parts[11])


def _absolute(namespace: str) -> str:
    return namespace if namespace.startswith("/") else f"/{namespace}"
