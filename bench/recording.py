"""What ``vtr record`` costs while the demo's human teaches: CPU, losses, and whether every message decodes."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import psutil
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

from bench import table
from cli import client, recorder, robot
from cli.demo.configuration import write_config
from cli.demo.driver import DriverSettings
from cli.demo.story import Story
from services.sensors.recordings.mcap import open_mcap

_ROOT = Path(__file__).resolve().parents[1]
_METRES = 40.0
_PEERS = {"receive": "receive and drop", "plain": "payloads as they came, mcap's Writer"}
"""Processes that are measured beside the recorder, by their argument: what receiving alone costs, and what a recorder
costs that looks into no message, as rosbag2's: nothing decoded or checked, no views, and no file when it is killed."""


def main() -> None:
    """Prints one row for the recorder and one for each peer, all on the same samples at once."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        write_config(folder / "robot.toml", folder / "data")
        with Story(folder / "robot.toml", lambda _text, _part: None) as story, contextlib.ExitStack() as stack:
            command = [sys.executable, "-m", "cli", "record", "-o", str(folder / "bag"), "--json"]
            recording = stack.enter_context(_running([*command, "--config", str(folder / "robot.toml")]))
            peers = [
                stack.enter_context(_running([sys.executable, "-m", "bench.recording", peer, str(folder)]))
                for peer in _PEERS
            ]
            time.sleep(4.0)
            watched = {"vtr record": psutil.Process(recording.pid)}
            watched |= {name: psutil.Process(peer.pid) for name, peer in zip(_PEERS.values(), peers, strict=True)}
            before = {name: _cpu(process) for name, process in watched.items()}
            began = time.monotonic()
            route = story.route()
            story.teach(route[: max(2, int(len(route) * _METRES / _length(route)))], DriverSettings())
            seconds = time.monotonic() - began
            spent = {name: (_cpu(process) - before[name]) / seconds for name, process in watched.items()}
            memory = {name: process.memory_info().rss / 1e6 for name, process in watched.items()}
            answer = json.loads(_end(recording))
            losses = [answer["lost"], *(json.loads(_end(peer)) for peer in peers)]
        decoded = _decoded(folder / "bag")
    total = sum(answer["messages"].values())
    rate = answer["bytes"] / answer["seconds"] / 1e6
    table.show(
        f"Recording the demo for {seconds:.0f} s of a teach, all topics",
        ["process", "CPU, cores", "memory, MB", "lost"],
        [
            [name, spent[name], memory[name], ", ".join(f"{key} {n}" for key, n in lost.items()) or "nothing"]
            for name, lost in zip(watched, losses, strict=True)
        ],
        f"{total} messages of ours, {rate:.1f} MB/s; {decoded} messages in the file decode by their schemas. What all "
        "lost never left its sender or the router.",
    )


def _length(route: Any) -> float:  # noqa: ANN401, an array (N, 3)
    steps = route[1:, :2] - route[:-1, :2]
    return float((steps**2).sum(axis=1).__pow__(0.5).sum())


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _decoded(folder: Path) -> int:
    """Messages of all channels, each decoded by its own schema; ours by their models as well."""
    count = 0
    for file in open_mcap(folder).files:
        with file.open("rb") as stream:
            factories = [DecoderFactory()]
            for schema, channel, message in make_reader(stream).iter_messages():
                if channel.message_encoding == "protobuf":
                    decoder = factories[0].decoder_for("protobuf", schema)
                    assert decoder is not None
                    decoder(message.data)
                    count += 1
    return count + sum(Counter(found.entry.key for found in open_mcap(folder).recorded()).values())


@contextlib.contextmanager
def _running(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    environment = {**os.environ, "PYTHONPATH": str(_ROOT)}
    process = subprocess.Popen(command, cwd=_ROOT, stdout=subprocess.PIPE, env=environment)  # noqa: S603, our own
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _end(process: subprocess.Popen[bytes]) -> str:
    process.send_signal(signal.SIGINT)
    return process.communicate(timeout=60)[0].decode()


def _receive(folder: Path, *, plain: bool) -> None:
    """Takes every sample until SIGINT, drops it or writes it as it came, and says what was lost."""
    stop = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    with client.connect(robot.load(folder / "robot.toml"), "bench") as bus, (folder / "plain.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channels: dict[str, int] = {}
        tap = bus.tap(recorder.choose([]))
        while not stop.wait(0.02):
            while (sample := tap.take()) is not None:
                if plain:
                    if sample.key not in channels:
                        channels[sample.key] = writer.register_channel(sample.key, "vtr", 0)
                    at, number = sample.arrival_ns, sample.envelope.sequence
                    writer.add_message(channels[sample.key], at, sample.payload, at, number & 0xFFFFFFFF)
        writer.finish()
        sys.stdout.write(json.dumps(+tap.lost))


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in _PEERS:
        _receive(Path(sys.argv[2]), plain=sys.argv[1] == "plain")
    else:
        main()
