"""Who publishes and who listens in a ROS graph, as its liveliness tokens tell, and what is missing."""

from __future__ import annotations

import threading

from services.sensors.ros2.names import Endpoint, Kind, Told, read_token, ros_type

_MOST = 4096


class GraphCache:
    """The endpoints of a graph's nodes, as ``rmw_zenoh`` keeps them; fed by Zenoh's thread."""

    def __init__(self, own: str) -> None:
        """Leaves out those of the node ``own``."""
        self._own = own
        self._lock = threading.Lock()
        self._tokens: dict[str, Told] = {}

    def told(self, key: str, here: bool) -> None:  # noqa: FBT001, a callback's
        """Takes a token that has come or gone."""
        told = read_token(key)
        if told is None or told.node == self._own:
            return
        with self._lock:
            if not here:
                self._tokens.pop(key, None)
            elif len(self._tokens) < _MOST:
                self._tokens[key] = told

    def why_silent(self, wanted: Endpoint) -> str:
        """What may be the reason that nothing comes of a topic."""
        found, anybody = self._others(wanted.topic, "MP")
        if any(_fits(told, wanted) for told in found):
            return "its publisher is there, and sends nothing"
        if found:
            return f"node '{found[0].node}' publishes it as {_difference(found[0], wanted)}"
        if anybody:
            return "nobody publishes it: is its name right?"
        return "no node is seen: are domain and endpoint right?"

    def why_unheard(self, sent: Endpoint) -> str | None:
        """Why nobody hears what is published on a topic; None where somebody does."""
        found, _ = self._others(sent.topic, "MS")
        if any(_fits(told, sent) for told in found):
            return None
        if found:
            return f"node '{found[0].node}' listens to it as {_difference(found[0], sent)}"
        return "nobody listens to it"

    def _others(self, topic: str, kind: Kind) -> tuple[list[Told], bool]:
        """The endpoints of a topic, and whether there is any of any topic."""
        with self._lock:
            found = [told for told in self._tokens.values() if (told.topic, told.kind) == (topic, kind)]
            return found, bool(self._tokens)


def _fits(told: Told, wanted: Endpoint) -> bool:
    return (told.dds, told.type_hash) == (wanted.dds, wanted.type_hash)


def _difference(told: Told, wanted: Endpoint) -> str:
    if told.dds != wanted.dds:
        return f"{ros_type(told.dds)}, not as {ros_type(wanted.dds)}"
    return f"{ros_type(told.dds)} with another hash: set distro to that of the robot's ROS"
