"""A node of a ROS graph, on a Zenoh session of its own: its publishers and its subscriptions."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh import ext

from common.bus.statistics import Statistics
from common.messages import now_ns
from services.sensors.ros2 import names, types
from services.sensors.ros2.attachment import Attachment, gid_of
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.names import Endpoint, Kind, Node
from services.sensors.ros2.qos import Qos
from services.sensors.ros2.settings import Ros2Settings

_OPEN_S = 1.0
_CDR = zenoh.Encoding("application/cdr")


@dataclass(frozen=True, slots=True)
class Arrived:
    """A decoded message, the monotonic time of its arrival, seconds, and its topic."""

    message: Any
    arrival: float
    topic: str


class RosPublisher:
    """The sending end of a topic; one publisher is used by one thread."""

    def __init__(self, graph: RosGraph, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.topic = endpoint.topic
        self._graph = graph
        self._gid = gid_of(graph.join("MP", endpoint))
        self._publisher = graph.declare_publisher(endpoint)
        self._sequence = 0

    def put(self, message: Any) -> None:  # noqa: ANN401, classes that rosbags makes at run time
        """Sends a message; while the graph is away it is lost, and counted."""
        self._sequence += 1
        attachment = Attachment(self._sequence, now_ns(), self._gid).pack() if self._graph.attaches else None
        try:
            self._publisher.put(types.encode(message), encoding=_CDR, attachment=attachment)
        except zenoh.ZError as error:
            self._graph.statistics.dropped(f"ros2{self.topic}", f"it could not be sent: {error}")
        else:
            self._graph.statistics.sent(f"ros2{self.topic}")


class RosSubscription:
    """The newest ``depth`` unread samples of one topic; nothing is decoded before it is asked for."""

    def __init__(self, graph: RosGraph, type_name: str, endpoint: Endpoint, wake: threading.Event) -> None:
        self.endpoint = endpoint
        self.topic = endpoint.topic
        self.type_name = type_name
        self._graph = graph
        self._key = graph.key(endpoint)
        self._unread: deque[tuple[zenoh.Sample, float]] = deque(maxlen=endpoint.qos.depth)
        self._wake = wake
        self.heard = time.monotonic()
        graph.join("MS", endpoint)
        graph.declare_subscriber(endpoint, self._hand_over)

    def _hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: keeps the sample for the consumer, and nothing else."""
        self._unread.append((sample, time.monotonic()))
        self._wake.set()

    def take(self) -> Arrived | None:
        """The oldest unread message that is one, None where there is none."""
        while self._unread:
            sample, arrival = self._unread.popleft()
            try:
                message = types.decode(self.type_name, self._payload(sample))
            except RosDataError as error:
                self._graph.statistics.dropped(f"ros2{self.topic}", str(error))
                continue
            self.heard = arrival
            return Arrived(message, arrival, self.topic)
        return None

    def drop(self, reason: str) -> None:
        """Counts a message that is of no use."""
        self._graph.statistics.dropped(f"ros2{self.topic}", reason)

    def _payload(self, sample: zenoh.Sample) -> bytes:
        if sample.kind != zenoh.SampleKind.PUT:
            raise RosDataError("a deletion is no message")
        key = str(sample.key_expr)
        if key != self._key:
            raise RosDataError(f"its key is {key!a}, and {self._key} was expected: another type, or another ROS?")
        return sample.payload.to_bytes()


class RosGraph:
    """The node; a context manager. What is declared ends with it."""

    def __init__(self, settings: Ros2Settings, statistics: Statistics) -> None:
        """Opens the session.

        Raises:
            zenoh.ZError: no router answers at the endpoint within a second.
        """
        self.statistics = statistics
        self._settings = settings
        self._lock = threading.Lock()
        self._endpoints = 0
        self._kept: list[Any] = []
        self._session: Any = zenoh.open(_session_config(settings.endpoint))
        self.attaches = settings.transport == "rmw_zenoh"
        self._node = Node(settings.domain, str(self._session.info.zid()), settings.namespace, settings.node)
        if self.attaches:
            self._keep(self._session.liveliness().declare_token(self._node.token()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()

    def connected(self) -> bool:
        """Whether the link to the router is up now."""
        return bool(list(self._session.info.routers_zid()) or list(self._session.info.peers_zid()))

    def publisher(self, name: str, type_name: str, qos: Qos) -> RosPublisher:
        """The sending end of a topic of the configuration."""
        return RosPublisher(self, self._endpoint(name, type_name, qos))

    def subscribe(self, name: str, type_name: str, qos: Qos, wake: threading.Event) -> RosSubscription:
        """The receiving end of one; ``wake`` is set at each arrival."""
        return RosSubscription(self, type_name, self._endpoint(name, type_name, qos), wake)

    def watch(self, told: Callable[[str, bool], None]) -> None:
        """Calls with each liveliness token of the graph, and whether it is there; in Zenoh's thread."""

        def hand_over(sample: zenoh.Sample) -> None:
            told(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        if self.attaches:
            everyone = names.all_tokens(self._settings.domain)
            self._keep(self._session.liveliness().declare_subscriber(everyone, hand_over, history=True))

    def _endpoint(self, name: str, type_name: str, qos: Qos) -> Endpoint:
        # A bridge puts its namespace before absolute names too.
        topic = names.resolve(name if self.attaches else name.lstrip("/"), self._settings.namespace)
        return Endpoint(topic, names.dds_type(type_name), types.hash_of(type_name, self._settings.distro), qos)

    def key(self, endpoint: Endpoint) -> str:
        """The key of an endpoint's samples."""
        if not self.attaches:
            return names.bridge_key(endpoint.topic)
        return names.topic_key(self._settings.domain, endpoint.topic, endpoint.dds, endpoint.type_hash)

    def join(self, kind: Kind, endpoint: Endpoint) -> str:
        """Shows an endpoint to the graph; returns its token."""
        with self._lock:
            self._endpoints += 1
            token = self._node.endpoint_token(self._endpoints, kind, endpoint)
        if self.attaches:
            self._keep(self._session.liveliness().declare_token(token))
        return token

    def declare_publisher(self, endpoint: Endpoint) -> Any:  # noqa: ANN401, one of two of Zenoh's classes
        """Zenoh's publisher of an endpoint; a latched one keeps its samples for who comes later."""
        options: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "reliability": zenoh.Reliability.RELIABLE if endpoint.qos.reliable else zenoh.Reliability.BEST_EFFORT,
            "express": True,
        }
        if endpoint.qos.latched:
            options |= {"cache": ext.CacheConfig(max_samples=endpoint.qos.depth), "publisher_detection": True}
            return ext.declare_advanced_publisher(self._session, self.key(endpoint), **options)
        return self._session.declare_publisher(self.key(endpoint), **options)

    def declare_subscriber(self, endpoint: Endpoint, receive: Callable[[zenoh.Sample], None]) -> None:
        """Zenoh's subscriber of an endpoint; of ``rmw_zenoh``, samples of other types come too, to be told of."""
        key = self.key(endpoint)
        if self.attaches:
            key = names.topic_key(self._settings.domain, endpoint.topic, "*", "*")
        if endpoint.qos.latched:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=endpoint.qos.depth)
            self._keep(ext.declare_advanced_subscriber(self._session, key, receive, history=history))
        else:
            self._keep(self._session.declare_subscriber(key, receive))

    def _keep(self, declared: Any) -> None:  # noqa: ANN401, Zenoh's
        with self._lock:
            self._kept.append(declared)


def _session_config(endpoint: str) -> zenoh.Config:
    """A client of the graph's router; once opened, it finds that router again whenever it is back."""
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "listen/endpoints": [],
        "connect/timeout_ms": round(_OPEN_S * 1000),
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
