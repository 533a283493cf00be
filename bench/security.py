"""What access control, passwords and mutual TLS cost: latency and throughput beside the same links without them."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import zenoh

from bench import table
from cli.keys.folder import KeyFolder
from common import config, topics
from common.access.link import client_settings
from common.access.names import Role
from common.bus import Bus
from common.messages import CameraModel, Message, StereoFrame, Truth, now_ns
from services.storage.weed import free_ports

_ROOT = Path(__file__).resolve().parents[1]
_NAME, _CAMERA = "bench", "front"
_ROUNDS = 2
_SAMPLES = 100
_WARM_UP = 15
_PERIOD_S = 0.02
_SECONDS = 1.5
_SIZES = ((0, 0), (160, 104))
"""Widths and heights of RGB stereo frames of 0.1 MB; (0, 0) stands for a small message."""

_SEND = "send"


@dataclass(frozen=True, slots=True)
class Network:
    """Two ends: who sends, on the robot, and who listens, on the robot or behind the fleet's router as well."""

    name: str
    sender: Path
    receiver: Path
    process: str
    routers: tuple[Path, ...]


def main() -> None:
    """Prints latency and throughput by way and payload."""
    with TemporaryDirectory() as folder:
        pairs = [
            (
                "on a robot",
                _one_router(Path(folder), secure=False),
                _one_router(Path(folder), secure=True),
            ),
            (
                "to an operator",
                _two_routers(Path(folder), secure=False),
                _two_routers(Path(folder), secure=True),
            ),
        ]
        rows = [_row(way, plain, secure, size) for way, plain, secure in pairs for size in _SIZES]
    table.show(
        "Security: passwords and rights on a robot, mutual TLS and rights to the fleet, beside the same without",
        ["way", "payload", "p50 ms plain", "secure", "ratio", "p99 plain", "secure", "per s plain", "secure", "ratio"],
        rows,
        f"the best of {_ROUNDS} rounds of {_SAMPLES} samples at {1 / _PERIOD_S:.0f} Hz, and of as many as go through; "
        "one router on a robot, two to an operator; no shared memory; refusals are logged",
    )


def _row(way: str, plain: Network, secure: Network, size: tuple[int, int]) -> list[object]:
    """The best of some rounds, one network after the other: whatever else this machine does only makes them worse."""
    best: dict[Network, list[float]] = {}
    for _ in range(_ROUNDS):
        for network in (plain, secure):
            with _up(network):
                p50, p99 = np.percentile(_latencies(network, size), [50, 99])
                figures = [float(p50), float(p99), -_throughput(network, size)]
            best[network] = [min(pair) for pair in zip(figures, best.get(network, figures), strict=True)]
    (p50, p99, rate), (p50_secure, p99_secure, rate_secure) = best[plain], best[secure]
    label = "0.2 kB" if size == (0, 0) else f"{2 * 3 * size[0] * size[1] / 1e3:.0f} kB"
    latencies = [p50, p50_secure, p50_secure / p50, p99, p99_secure]
    return [way, label, *latencies, -rate, -rate_secure, rate_secure / rate]


# --- configurations --------------------------------------------------------------------------------------------------


def _one_router(folder: Path, *, secure: bool) -> Network:
    folder = folder / f"one-{secure}"
    (port,) = free_ports(1)
    keys = _keys(folder) if secure else None
    users = f'[security]\nusers = "{keys / _NAME / "users"}"\n' if keys else ""
    path = _write(folder, "robot.toml", f'[robot]\nname = "{_NAME}"\n[bus]\nendpoint = "tcp/127.0.0.1:{port}"\n{users}')
    return Network("one", path, path, "recorder", (path,))


def _two_routers(folder: Path, *, secure: bool) -> Network:
    folder = folder / f"two-{secure}"
    robot, local, door = free_ports(3)
    keys = _keys(folder) if secure else None
    of_robot = of_server = of_operator = ""
    outside = f"tcp/127.0.0.1:{local}"
    if keys:
        outside = f"tls/127.0.0.1:{door}"
        of_robot = _security(keys, _NAME) + f'users = "{keys / _NAME / "users"}"\n'
        of_server = _security(keys, "central") + f'listen = "{outside}"\nmembers = "{keys / "register.json"}"\n'
        of_operator = _security(keys, "alice")
    head = f'[robot]\nname = "{_NAME}"\n[bus]\nfleet_frames_hz = 1000.0\n'
    sender = f'{head}endpoint = "tcp/127.0.0.1:{robot}"\nfleet = "{outside}"\n{of_robot}'
    server = f'[server]\n[bus]\nendpoint = "tcp/127.0.0.1:{local}"\n{of_server}'
    receiver = f'{head}endpoint = "{outside}"\n{of_operator}'
    paths = [
        _write(folder, name, text)
        for name, text in (("robot.toml", sender), ("fleet.toml", server), ("operator.toml", receiver))
    ]
    return Network("two", paths[0], paths[2], "operator", (paths[1], paths[0]))


def _keys(folder: Path) -> Path:
    keys = KeyFolder(folder / "keys")
    keys.create("bench")
    keys.issue(Role.SERVER, "central", ["127.0.0.1"], 1)
    keys.issue(Role.ROBOT, _NAME, [], 1)
    keys.issue(Role.OPERATOR, "alice", [], 1)
    return keys.path


def _security(keys: Path, owner: str) -> str:
    own = keys / owner
    return (
        f'[security]\nca = "{own / "ca.pem"}"\ncertificate = "{own / "certificate.pem"}"\nkey = "{own / "key.pem"}"\n'
    )


def _write(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# --- measurements ----------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def _up(network: Network) -> Iterator[None]:
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    routers = []
    for path in network.routers:
        command = [sys.executable, "-m", "services.router", "--config", str(path)]
        routers.append(subprocess.Popen(command, cwd=_ROOT, env=environment, stderr=subprocess.DEVNULL))  # noqa: S603, ours
    try:
        yield
    finally:
        for router in routers:
            router.terminate()
            router.wait()


def _latencies(network: Network, size: tuple[int, int]) -> list[float]:
    """Milliseconds from before encoding to the arrival in the other process, decoded."""
    milliseconds: list[float] = []
    with _open(network.receiver, network.process) as bus, _sending(network, size, _PERIOD_S):
        subscription = bus.subscribe(topics.STEREO if size[0] else topics.TRUTH)
        while len(milliseconds) < _SAMPLES + _WARM_UP:
            received = subscription.wait(20.0)
            if received is None:
                raise SystemExit("no sample arrives: a router or the sender has failed")
            milliseconds.append((now_ns() - received.message.stamp) / 1e6)
    return milliseconds[_WARM_UP:]


def _throughput(network: Network, size: tuple[int, int]) -> float:
    """Samples a second that arrive of a sender which does not pause."""
    arrived = 0
    first = threading.Event()

    def count(_sample: zenoh.Sample) -> None:
        nonlocal arrived
        arrived += 1
        first.set()

    topic = topics.STEREO if size[0] else topics.TRUTH
    with _open(network.receiver, network.process) as bus, _sending(network, size, 0.0):
        bus.session.declare_subscriber(topic.at(_NAME, _CAMERA), count)
        if not first.wait(20.0):
            raise SystemExit("no sample arrives: a router or the sender has failed")
        time.sleep(0.3)
        before, begun = arrived, time.monotonic()
        time.sleep(_SECONDS)
        return (arrived - before) / (time.monotonic() - begun)


@contextlib.contextmanager
def _sending(network: Network, size: tuple[int, int], period: float) -> Iterator[None]:
    command = [sys.executable, "-m", "bench.security", _SEND, str(network.sender), *map(str, size), str(period)]
    sender = subprocess.Popen(command, cwd=_ROOT)  # noqa: S603, our own
    try:
        yield
    finally:
        sender.kill()
        sender.wait()


def _send(path: Path, width: int, height: int, period: float) -> None:
    """Publishes frames, or small messages, until this process is killed."""
    with _open(path, "sensors") as bus:
        publisher = bus.publisher(topics.STEREO if width else topics.TRUTH, _CAMERA)
        while True:
            publisher.put(_message(width, height))
            time.sleep(period)


def _open(path: Path, process: str) -> Bus:
    loaded = config.load(path)
    shown = client_settings(loaded, process)
    return Bus(_NAME, process, loaded.bus.endpoint, shared_memory=False, timeout=20, access=shown)


def _message(width: int, height: int) -> Message:
    if not width:
        return Truth(stamp=now_ns(), T_world_vehicle=np.eye(4), v=1.0, w=0.0)
    camera = CameraModel(
        width=width, height=height, fx=300.0, fy=300.0, cx=0.0, cy=0.0, baseline=0.2, T_vehicle_camera=np.eye(4)
    )
    image = np.zeros((height, width, 3), np.uint8)
    return StereoFrame(stamp=now_ns(), camera=camera, left=image, right=image)


if __name__ == "__main__":
    if sys.argv[1:2] == [_SEND]:
        _send(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), float(sys.argv[5]))
    else:
        main()
