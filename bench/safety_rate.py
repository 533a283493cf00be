"""The rate of ``command/safe`` while every core is busy: how late its cycles are, at safety and at the base.

The peer, in the same run, is a bare loop as urgent as safety that does nothing but wake up: as late as it is, the
machine itself was.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import zenoh
from numpy.typing import NDArray

from bench import table
from common import logs, topics, wire
from common.bus import Bus
from common.messages import VelocityCommand
from common.priority import be_on_time

Array = NDArray[np.float64]

_ROOT = Path(__file__).resolve().parents[1]
_PERIOD_S = 1.0 / topics.SAFE.rate_hz
_AIM_S = 0.01
_WARM_UP_S = 3.0
_SECONDS = 20.0
_START_DEADLINE_S = 60.0
_QUANTILES = (50.0, 99.0, 99.9, 100.0)
_CORES = os.cpu_count() or 1
_RECEIVE, _WAKE = "receive", "wake"


def main(seconds: float = _SECONDS) -> None:
    """Prints the errors of the intervals with idle cores and with a busy loop on each."""
    rows: list[list[object]] = []
    for name, loops in (("nobody", 0), (f"{_CORES} busy loops", _CORES)):
        for what, times in _measure(loops, seconds).items():
            errors = np.abs(np.diff(times) - _PERIOD_S)
            quantiles = map(float, np.percentile(errors * 1e3, _QUANTILES))
            rate = float((len(times) - 1) / (times[-1] - times[0]))
            rows.append([name, what, rate, *quantiles, int((errors > _AIM_S).sum())])
    table.show(
        f"command/safe: |interval - {_PERIOD_S * 1e3:.0f} ms|, ms, over {seconds:.0f} s",
        ["beside safety", "what", "Hz", "p50", "p99", "p99.9", "most", f"beyond {_AIM_S * 1e3:.0f} ms"],
        rows,
        "sent: by the stamps; arrived: through the router, at a receiver as urgent as safety",
    )


def _measure(loops: int, seconds: float) -> dict[str, Array]:
    """Times (s) at which commands were made, at which they arrived, and at which the bare loop woke up."""
    with TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        config, endpoint = _configuration(Path(folder))
        for service in ("router", "safety"):
            stack.enter_context(_process(["-m", f"services.{service}", "--config", str(config)]))
        for _ in range(loops):
            stack.enter_context(_process(["-c", "while True: pass"]))
        roles = ([_RECEIVE, str(seconds), endpoint], [_WAKE, str(seconds)])
        measuring = [stack.enter_context(_process(["-m", "bench.safety_rate", *role])) for role in roles]
        (sent, arrived), wakes = [json.loads(process.communicate()[0]) for process in measuring]
        return {"sent": np.array(sent), "arrived": np.array(arrived), "bare loop": np.array(wakes)}


def _receive(seconds: float, endpoint: str) -> None:
    """Prints the times at which the commands were made, and at which they arrived."""
    samples: list[tuple[float, zenoh.Sample]] = []
    first = threading.Event()

    def keep(sample: zenoh.Sample) -> None:
        samples.append((time.monotonic(), sample))
        first.set()

    with Bus("bench", "base", endpoint, shared_memory=False, timeout=_START_DEADLINE_S) as bus:
        be_on_time()
        subscriber = bus.session.declare_subscriber(topics.SAFE.at("bench"), keep)
        if not first.wait(_START_DEADLINE_S):
            raise SystemExit("safety sends nothing: it has failed to start")
        time.sleep(_WARM_UP_S)
        samples.clear()
        time.sleep(seconds)
        subscriber.undeclare()  # type: ignore[no-untyped-call]
        print(json.dumps([[_stamp(sample) for _, sample in samples], [arrival for arrival, _ in samples]]))


def _stamp(sample: zenoh.Sample) -> float:
    return wire.decode(VelocityCommand, sample.payload.to_bytes()).stamp * 1e-9


def _wake(seconds: float) -> None:
    """Prints the times at which a loop on safety's schedule, in a thread of its own as safety's is, wakes up."""
    be_on_time()
    times: list[float] = []

    def loop() -> None:
        due = time.monotonic()
        begin = due + _WARM_UP_S
        while due < begin + seconds:
            time.sleep(max(due - time.monotonic(), 0.0))
            times.append(time.monotonic())
            due += _PERIOD_S * max(int((times[-1] - due) / _PERIOD_S) + 1, 1)

    thread = threading.Thread(target=loop)
    thread.start()
    thread.join()
    print(json.dumps(times[round(_WARM_UP_S / _PERIOD_S) :]))


def _configuration(folder: Path) -> tuple[Path, str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    path = folder / "robot.toml"
    path.write_text(
        f'[robot]\nname = "bench"\ndirectory = "{folder}"\nlog_level = "error"\n'
        f'[bus]\nendpoint = "{endpoint}"\nshared_memory = false\n'
    )
    return path, endpoint


@contextlib.contextmanager
def _process(arguments: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(  # noqa: S603, ours
        [sys.executable, *arguments], cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


if __name__ == "__main__":
    logs.configure("bench", "base", "error")
    if sys.argv[1:2] == [_RECEIVE]:
        _receive(float(sys.argv[2]), sys.argv[3])
    elif sys.argv[1:2] == [_WAKE]:
        _wake(float(sys.argv[2]))
    else:
        parser = argparse.ArgumentParser(prog="python -m bench.safety_rate", description=__doc__)
        parser.add_argument("--seconds", type=float, default=_SECONDS, help="of each measurement")
        main(parser.parse_args().seconds)
