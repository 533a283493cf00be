"""What a process keeps of the shared memory of others that are begun anew again and again."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from common import topics
from common.bus import Bus
from common.ids import VertexId, new_map_id
from common.messages import Route
from tests.processes import ROOT, eventually, free_port

LIVES = 3
VERTICES = 2000
PUTS = 15
"""Zenoh prepares shared memory in the background, while the first samples travel without."""
STATUS = Path("/proc/self/status")

SENDER = """
import os, sys
from tests.common.test_shared_memory import send
send(sys.argv[1])
os._exit(0)
"""


def send(endpoint):
    """A life of the navigator, which publishes a route of some hundred kilobytes and is gone."""
    record = new_map_id("r1", 0)
    route = Route(
        id="route1", environment="default", goal="end", vertices=[VertexId(record, k) for k in range(VERTICES)],
        path=np.tile(np.eye(4), (VERTICES, 1, 1)), length=1.0, maps=[record], reason="the only map",
    )  # fmt: skip
    with Bus("r1", "navigator", endpoint) as bus:
        publisher = bus.publisher(topics.ROUTE)
        for _ in range(PUTS):
            publisher.put(route)
            time.sleep(0.02)
        sys.stdin.read()


def shared_kb():
    return next(int(line.split()[1]) for line in STATUS.read_text().splitlines() if line.startswith("RssShmem"))


@pytest.mark.skipif(not STATUS.exists(), reason="tells what is mapped on Linux only")
def test_a_receiver_keeps_no_memory_of_senders_that_are_gone():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Bus("r1", "router", endpoint, mode="router"), Bus("r1", "estimator", endpoint, timeout=10) as bus:
        routes = bus.subscribe(topics.ROUTE)
        before = shared_kb()
        for life in range(1, LIVES + 1):
            command = [sys.executable, "-c", SENDER, endpoint]
            sender = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE)
            try:
                for number in range(PUTS):
                    eventually(routes.poll, f"route {number} of life {life} arrives", 20.0)
            finally:
                sender.communicate(timeout=20.0)
        assert shared_kb() - before < 1000
