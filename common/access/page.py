"""The rights as docs/security.md shows them."""

from __future__ import annotations

from common.topics import ALL, OF_THE_FLEET, Delivery, Topic

_HEAD = "| topic | sent or answered by | asked by | operator | viewer |\n|---|---|---|---|---|\n"


def rights_table() -> str:
    """A row for each topic: the processes on the robot, or of the server, and what comes from elsewhere."""
    return _HEAD + "".join(_row(topic) for topic in (*ALL, *OF_THE_FLEET))


def _row(topic: Topic) -> str:
    key = f"fleet/{topic.key}" if topic.fleet else topic.key
    owners = "each its own" if topic.owners == ("*",) else ", ".join(topic.owners)
    anybody = topic.askers == ("*",)
    if topic.delivery is not Delivery.QUERY:
        cells = [owners, "", "sends" if "operator" in topic.owners else "", ""]
    else:
        asks = "asks" if anybody or "operator" in topic.askers else ""
        cells = [owners, "anybody" if anybody else ", ".join(topic.askers), asks, "asks" if anybody else ""]
    return f"| `{key}` | {' | '.join(cells)} |\n"
