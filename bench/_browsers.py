"""Twenty browsers without windows: ``python -m bench._browsers URL COUNT SECONDS`` prints what they were sent."""

from __future__ import annotations

import asyncio
import json
import sys
import time
from dataclasses import dataclass, field

import numpy as np
from tornado.websocket import WebSocketClientConnection, websocket_connect


@dataclass(slots=True)
class Seen:
    """What all browsers together were sent: bytes and messages, and seconds from a frame's stamp to its arrival."""

    first: int = 0
    later: int = 0
    messages: int = 0
    pictures: int = 0
    ages: list[float] = field(default_factory=list)


def main() -> None:
    """Opens the pages, watches, and prints one JSON object."""
    url, count, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    seen = Seen()
    asyncio.run(_all(url, count, seconds, seen))
    p50, p99 = np.percentile(seen.ages or [np.nan], [50, 99]).tolist()
    figures = {
        "first": seen.first / count, "later": seen.later / count / seconds, "messages": seen.messages / count / seconds,
        "pictures": seen.pictures / count / seconds, "p50": p50, "p99": p99,
    }  # fmt: skip
    sys.stdout.write(json.dumps(figures))


async def _all(url: str, count: int, seconds: float, seen: Seen) -> None:
    sockets = [await websocket_connect(url) for _ in range(count)]
    end = time.monotonic() + seconds
    await asyncio.gather(*(_watch(socket, end, seen) for socket in sockets))


async def _watch(socket: WebSocketClientConnection, end: float, seen: Seen) -> None:
    while time.monotonic() < end:
        message = await socket.read_message()
        if message is None:
            return
        arrived = time.time()
        if isinstance(message, bytes):
            seen.pictures += 1
            seen.later += len(message)
            continue
        told = json.loads(message)
        if told.get("all"):
            seen.first += len(message)
            continue
        seen.messages += 1
        seen.later += len(message)
        stamp = told.get("set", {}).get("live", {}).get("stamp")
        if stamp is not None:
            seen.ages.append(arrived - stamp * 1e-9)
    socket.close()


if __name__ == "__main__":
    main()
