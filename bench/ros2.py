"""What a stereo pair of a ROS graph costs the process ``sensors``, beside one that publishes the same pair itself."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import psutil
import zenoh
from numpy.typing import NDArray

from bench import table
from common import topics
from common.bus import Bus
from common.messages import CameraModel, StereoFrame, now_ns
from services.sensors.ros2 import names, types
from services.sensors.ros2.types import header, make
from services.sensors.world import World, WorldSettings

_ROOT = Path(__file__).resolve().parents[1]
_HZ, _SECONDS, _WARM_UP = 10.0, 10.0, 20
_DIRECT = "publishes the pair itself"
_KINDS = {
    "rgb8": "left/image_rect",
    "bgr8": "left/image_rect",
    "rgb8, raw, rectified by its camera info": "left/image_raw",
    "JPEG": "left/image_rect/compressed",
}


def main() -> None:
    """Prints a row for each encoding, and one for a process that publishes the pair itself."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        _picture(folder)
        direct = _measured(folder, None)
        rows = [[_DIRECT, *direct, 1.0, 1.0]]
        for kind in _KINDS:
            cpu, latency = _measured(folder, kind)
            rows.append([kind, cpu, latency, cpu / direct[0], latency / direct[1]])
    table.show(
        "A stereo pair of 640x400 RGB, 1.5 MB: sensors with the driver ros2, beside a direct publisher",
        ["the pair", "CPU, ms a pair", "latency, ms, p50", "CPU, ratio", "latency, ratio"],
        rows,
        f"{_HZ:g} pairs a second over {_SECONDS:g} s, shared memory on the robot's bus; latency from before the pair "
        "is made in the one process until it is decoded in another, and of ROS through its own router first. CPU is "
        "all that the process uses.",
    )


def _measured(folder: Path, kind: str | None) -> tuple[float, float]:
    """CPU milliseconds a pair of the process ``sensors``, and the median latency."""
    ours, theirs = _endpoint(), _endpoint()
    config, other = folder / "robot.toml", folder / "ros.toml"
    other.write_text(_tables("ros", theirs), encoding="utf-8")
    config.write_text(_tables("bench", ours) + _driver(theirs, _KINDS.get(kind or "", "left/image_rect")))
    with contextlib.ExitStack() as stack:
        for path in (config, other):
            stack.enter_context(_running("-m", "services.router", "--config", str(path)))
        bus = stack.enter_context(Bus("bench", "observer", ours, timeout=20.0))
        if kind is None:
            sensors = stack.enter_context(_running("-m", "bench.ros2", _DIRECT, ours, str(folder)))
        else:
            sensors = stack.enter_context(_running("-m", "services.sensors", "--config", str(config)))
            stack.enter_context(_running("-m", "bench.ros2", kind, theirs, str(folder)))
        return _collect(bus, psutil.Process(sensors.pid))


def _collect(bus: Bus, sensors: psutil.Process) -> tuple[float, float]:
    frames = bus.subscribe(topics.STEREO)
    for _ in range(_WARM_UP):
        _next(frames)
    before, began, latencies = _cpu(sensors), time.monotonic(), []
    while time.monotonic() - began < _SECONDS:
        frame = _next(frames)
        latencies.append((now_ns() - frame.stamp) / 1e6)
    return 1e3 * (_cpu(sensors) - before) / len(latencies), float(np.median(latencies))


def _next(frames: Any) -> StereoFrame:  # noqa: ANN401, a subscription
    received = frames.wait(20.0)
    if received is None:
        raise SystemExit("no pair arrives: the router, the driver or the sender has failed")
    frame: StereoFrame = received.message
    return frame


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _picture(folder: Path) -> None:
    world = World()
    world.warm_up(lidar=False)
    left, right = world.render()
    np.savez(folder / "pair.npz", left=left, right=right)


def _tables(name: str, endpoint: str) -> str:
    return f'[robot]\nname = "{name}"\nlog_level = "error"\n[bus]\nendpoint = "{endpoint}"\n'


def _driver(endpoint: str, left: str) -> str:
    return (
        f'[sensors]\ndriver = "ros2"\n[sensors.ros2]\nendpoint = "{endpoint}"\nmounting = "none"\n'
        f'[sensors.ros2.inputs]\nleft = "{left}"\nright = "{left.replace("left", "right")}"\n'
    )


def _endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def _running(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, *arguments], cwd=_ROOT)  # noqa: S603, our own
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _send_directly(endpoint: str, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> None:
    camera = CameraModel.of(WorldSettings().camera)
    with Bus("bench", "sensors", endpoint) as bus:
        pairs = bus.publisher(topics.STEREO, "front")
        for _ in _due():
            pairs.put(StereoFrame(stamp=now_ns(), camera=camera, left=left, right=right))


def _send_as_ros(kind: str, endpoint: str, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> None:
    config = zenoh.Config()
    for key, value in (("mode", "client"), ("connect/endpoints", [endpoint]), ("connect/timeout_ms", 20000)):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        for _ in _due():
            stamp = now_ns()
            for side, pixels in (("left", left), ("right", right)):
                topic = _KINDS[kind].replace("left", side)
                _put(session, names.sibling(topic, "camera_info"), _info(stamp, side, kind))
                _put(session, topic, _image(stamp, pixels, kind))


def _due() -> Iterator[None]:
    due = time.monotonic()
    while True:
        yield
        due = max(due + 1.0 / _HZ, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


def _put(session: zenoh.Session, topic: str, message: Any) -> None:  # noqa: ANN401, classes of rosbags
    kind = message.__msgtype__
    session.put(names.topic_key(0, topic, names.dds_type(kind), types.hash_of(kind, "jazzy")), types.encode(message))


def _image(stamp: int, pixels: NDArray[np.uint8], kind: str) -> Any:  # noqa: ANN401
    height, width = pixels.shape[:2]
    if kind == "JPEG":
        return make(types.COMPRESSED, header(stamp, "optical"), "rgb8; jpeg compressed bgr8", _jpeg(pixels))
    encoding = kind.partition(",")[0]
    return make(types.IMAGE, header(stamp, "optical"), height, width, encoding, 0, 3 * width, pixels.reshape(-1))


def _jpeg(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1], np.uint8).reshape(-1)


def _info(stamp: int, side: str, kind: str) -> Any:  # noqa: ANN401
    c = WorldSettings().camera
    K = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1.0])
    P = np.array([c.fx, 0, c.cx, -c.fx * c.baseline * (side == "right"), 0, c.fy, c.cy, 0, 0, 0, 1, 0.0])
    D = np.array([-0.1, 0.02, 0, 0, 0]) if "raw" in kind else np.zeros(5)
    roi = make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    sizes = (c.height, c.width, "plumb_bob", D, K, np.eye(3).reshape(-1), P, 0, 0)
    return make(types.CAMERA_INFO, header(stamp, "optical"), *sizes, roi)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        pair = np.load(Path(sys.argv[3]) / "pair.npz")
        if sys.argv[1] == _DIRECT:
            _send_directly(sys.argv[2], pair["left"], pair["right"])
        else:
            _send_as_ros(sys.argv[1], sys.argv[2], pair["left"], pair["right"])
    else:
        main()
