"""What the fleet's page costs: the console's share of a core, and how soon a slider is answered.

An environment of 300 maps between 40 places, whose server is acted; the console is a real process, asked over
WebSockets as pages ask it: each looks again every ten seconds, and who moves a slider asks as soon as the last answer
is there, at most 20 times a second. Beside it the same plan as the fleet's server computes it, in this process.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from tornado.websocket import WebSocketClientConnection, websocket_connect

from bench.table import show
from common.bus import Bus
from common.environment import MapTable, Network, Theta, plan
from common.environment.told import map_told, model_told
from common.topics import FLEET
from tests.processes import Robot, free_port
from tests.services.console.fleet.standin import StandIn, entries, model

_MAPS, _PLACES = 300, 40
_SECONDS = 8.0
_AGAIN_S, _SLIDER_S = 10.0, 0.05
_AT = 466_000.0


def main() -> None:
    """Measures with nobody, with pages that are only open, and with sliders that move."""
    rows = []
    port = free_port()
    with tempfile.TemporaryDirectory() as folder, Robot(Path(folder), f"[console]\nport = {port}\n") as robot:
        console = psutil.Process(robot.start("console").pid)
        with Bus(FLEET, FLEET, robot.endpoint, shared_memory=False) as bus:
            server = StandIn(bus)
            server.environments["big"] = _maps()
            server.learn(model(environment="big"))
            for name, pages, sliders in (
                ("nobody looks", 0, 0),
                ("1 page", 1, 0),
                ("20 pages", 20, 0),
                ("20, one slides", 20, 1),
            ):
                rows.append([name, *asyncio.run(_watched(console, f"ws://127.0.0.1:{port}/ws/fleet", pages, sliders))])
    rows.append(["the plan alone, in one process", "", "", *_alone()])
    columns = ["who looks", "console, % of a core", "answers/s", "answer p50, ms", "p99, ms"]
    show(f"the fleet's page at {_MAPS} maps", columns, rows)


def _maps() -> list[Any]:
    random = np.random.default_rng(3)
    starts = random.integers(0, _PLACES, _MAPS)
    return entries(
        (
            f"map{k}",
            f"p{a}",
            f"p{(a + 1 + k % 3) % _PLACES}",
            f"2023-02-{1 + k % 28:02d} {k % 24:02d}:00",
            20.0 + k % 30,
        )
        for k, a in enumerate(starts.tolist())
    )


async def _watched(console: psutil.Process, url: str, pages: int, sliders: int) -> list[Any]:
    sockets = [await websocket_connect(url) for _ in range(pages)]
    curves = [await _ask(socket, 0, _AT, "") for socket in sockets]
    taken: list[float] = []
    before, began = sum(console.cpu_times()[:2]), time.monotonic()
    looking = (
        _look(socket, one, _SLIDER_S if k < sliders else _AGAIN_S, k / max(pages, 1), taken)
        for k, (socket, one) in enumerate(zip(sockets, curves, strict=True))
    )
    await asyncio.gather(asyncio.sleep(_SECONDS), *looking)
    passed = time.monotonic() - began
    share = 100.0 * (sum(console.cpu_times()[:2]) - before) / passed
    for socket in sockets:
        socket.close()
    p50, p99 = np.percentile(np.array(taken) * 1e3, [50, 99]).tolist() if taken else ("", "")
    return [round(share, 1), round(len(taken) / passed, 1), p50, p99]


async def _look(
    socket: WebSocketClientConnection, curves: str, period: float, begin: float, taken: list[float]
) -> None:
    """A page that has drawn its curves; ``begin`` is the part of a period after which it looks first."""
    end = time.monotonic() + _SECONDS
    await asyncio.sleep(begin * period)
    number = 0
    while (begun := time.monotonic()) < end:
        number += 1
        await _ask(socket, number, _AT + 0.05 * (number % 400), curves)
        taken.append(time.monotonic() - begun)
        await asyncio.sleep(min(max(period - taken[-1], 0.0), max(end - time.monotonic(), 0.0)))


async def _ask(socket: WebSocketClientConnection, number: int, at: float, curves: str) -> str:
    asked = {
        "environment": "big", "at_hours": at, "theta": [1, 0.2, 0], "start": "p0", "goal": "p20", "curves": curves
    }  # fmt: skip
    await socket.write_message(json.dumps({"id": number, "do": "costs", "with": asked}))
    while True:
        told = json.loads(await socket.read_message() or "{}")
        if told.get("re") == number:
            return str(told["told"]["curves"])


def _alone() -> list[Any]:
    table = MapTable.of(map(map_told, _maps()))
    network, known = Network.of(table), model_told(model())
    taken = []
    for number in range(200):
        begun = time.perf_counter()
        plan(table, network, known, "p0", "p20", _AT + 0.05 * number, Theta(1.0, 0.2, 0.0))
        taken.append(time.perf_counter() - begun)
    return np.percentile(np.array(taken[20:]) * 1e3, [50, 99]).tolist()


if __name__ == "__main__":
    main()
