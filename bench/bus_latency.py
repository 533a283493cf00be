"""One-way latency of messages between two processes through the robot's router: encode, put, receive, decode."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench import table
from common import topics
from common.bus import Bus, Subscription
from common.messages import CameraModel, Message, StereoFrame, Truth, now_ns

_ROOT = Path(__file__).resolve().parents[1]
_SAMPLES = 100
_PERIOD_S = 0.02
_WARM_UP = 10
_SIZES = ((0, 0), (160, 104), (400, 208), (640, 400))
"""Widths and heights of RGB stereo frames of 0.1, 0.5 and 1.5 MB; (0, 0) stands for a small message."""

_SEND = "send"


def main() -> None:
    """Prints the latency by payload, with and without shared memory."""
    rows: list[list[object]] = []
    for width, height in _SIZES:
        row: list[object] = [f"{_bytes(width, height) / 1e3:,.1f} kB"]
        for shared_memory in (False, True):
            milliseconds = _latencies(width, height, shared_memory=shared_memory)
            row += [float(q) for q in np.percentile(milliseconds, [50, 99])]
        rows.append(row)
    table.show(
        "Bus: one-way latency, ms, encode to decoded, client - router - client",
        ["payload", "p50", "p99", "p50, shared memory", "p99, shared memory"],
        rows,
        f"{_SAMPLES} samples at {1 / _PERIOD_S:.0f} Hz; each process on its own, the router in Python",
    )


def _latencies(width: int, height: int, *, shared_memory: bool) -> list[float]:
    """Milliseconds from before encoding in one process to after decoding in this one."""
    topic = topics.STEREO if width else topics.TRUTH
    with (
        TemporaryDirectory() as folder,
        _router(Path(folder), shared_memory=shared_memory) as endpoint,
        Bus("bench", "safety", endpoint, shared_memory=shared_memory, timeout=10) as bus,
    ):
        subscription = bus.subscribe(topic)
        command = [sys.executable, "-m", "bench.bus_latency", _SEND, endpoint, str(width), str(height)]
        sender = subprocess.Popen([*command, str(int(shared_memory))], cwd=_ROOT)  # noqa: S603, our own
        try:
            return _collect(subscription)
        finally:
            sender.kill()
            sender.wait()


def _collect(subscription: Subscription[Message]) -> list[float]:
    milliseconds: list[float] = []
    while len(milliseconds) < _SAMPLES + _WARM_UP:
        received = subscription.wait(10.0)
        if received is None:
            raise SystemExit("no sample arrives: the router or the sender has failed")
        sent: int = getattr(received.message, "stamp")  # noqa: B009, every message of these topics has one
        milliseconds.append((now_ns() - sent) / 1e6)
    return milliseconds[_WARM_UP:]


def _send(endpoint: str, width: int, height: int, *, shared_memory: bool) -> None:
    """Publishes frames, or small messages, until this process is killed."""
    topic = topics.STEREO if width else topics.TRUTH
    with Bus("bench", "sensors", endpoint, shared_memory=shared_memory) as bus:
        publisher = bus.publisher(topic, "front")
        while True:
            publisher.put(_message(width, height))
            time.sleep(_PERIOD_S)


def _message(width: int, height: int) -> Message:
    if not width:
        return Truth(stamp=now_ns(), T_world_vehicle=np.eye(4), v=1.0, w=0.0)
    camera = CameraModel(
        width=width, height=height, fx=300.0, fy=300.0, cx=0.0, cy=0.0, baseline=0.2, T_vehicle_camera=np.eye(4)
    )
    image = np.zeros((height, width, 3), np.uint8)
    return StereoFrame(stamp=now_ns(), camera=camera, left=image, right=image)


def _bytes(width: int, height: int) -> int:
    return 2 * 3 * width * height or 200


@contextlib.contextmanager
def _router(folder: Path, *, shared_memory: bool) -> Iterator[str]:
    """A router process of its own, on a port that nobody else uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    path = folder / "robot.toml"
    path.write_text(
        f'[robot]\nname = "bench"\nlog_level = "error"\n'
        f'[bus]\nendpoint = "{endpoint}"\nshared_memory = {str(shared_memory).lower()}\n',
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "services.router", "--config", str(path)]
    router = subprocess.Popen(command, cwd=_ROOT, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})  # noqa: S603, ours
    try:
        yield endpoint
    finally:
        router.terminate()
        router.wait()


if __name__ == "__main__":
    if sys.argv[1:2] == [_SEND]:
        _send(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), shared_memory=sys.argv[5] == "1")
    else:
        main()
