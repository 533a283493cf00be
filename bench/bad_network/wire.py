"""The bad network: IP packets between network namespaces, each late, some lost, none while a robot is cut off.

It is what ``tc netem`` does, for kernels without it. Each namespace has a TUN device whose packets come here; the
kernels' own TCP finds out what was lost and sends it again. ``python -m bench.bad_network.wire`` follows the last
plan, a line of JSON, that it read from its standard input, and prints what it carried when that input ends.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import selectors
import struct
import sys
import time
from dataclasses import asdict, dataclass, field
from ipaddress import IPv4Address
from pathlib import Path

from bench.bad_network.plan import Plan

DEVICE = "wire0"

_CLONE_NEWNET = 0x40000000
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_PACKET = 65536
_AT_ONCE = 64
_LONGEST_WAIT_S = 0.5


@dataclass(slots=True)
class Carried:
    """What became of the packets of one end, both ways."""

    packets: int = 0
    bytes: int = 0
    lost: int = 0
    cut: int = 0


@dataclass(slots=True)
class Wire:
    """Devices by namespace, addresses by device, and the packets under way."""

    handles: dict[str, int]
    addresses: dict[bytes, str]
    plan: Plan
    chance: random.Random = field(default_factory=lambda: random.Random(1))  # noqa: S311, a bench's dice
    under_way: list[tuple[float, int, str, str, bytes]] = field(default_factory=list)
    carried: dict[str, Carried] = field(default_factory=dict)
    number: int = 0

    def run(self) -> None:
        """Carries packets until standard input ends."""
        with selectors.DefaultSelector() as selector:
            selector.register(sys.stdin, selectors.EVENT_READ)
            for name, handle in self.handles.items():
                selector.register(handle, selectors.EVENT_READ, name)
            while True:
                due = self.under_way[0][0] - time.monotonic() if self.under_way else _LONGEST_WAIT_S
                for key, _ in selector.select(max(due, 0.0)):
                    if key.fileobj is sys.stdin:
                        if not (line := sys.stdin.readline()):
                            return
                        self.plan = Plan.parse(line)
                        continue
                    self._take(key.data)
                self._deliver(time.monotonic())

    def _take(self, source: str) -> None:
        for _ in range(_AT_ONCE):
            try:
                packet = os.read(self.handles[source], _PACKET)
            except BlockingIOError:
                return
            target = self.addresses.get(packet[16:20])
            if packet[0] >> 4 == 4 and target is not None and target != source:
                self._send(source, target, packet)

    def _send(self, source: str, target: str, packet: bytes) -> None:
        now = time.monotonic()
        robot = target if source == "fleet" else source
        counts = self.carried.setdefault(robot, Carried())
        if self.plan.cut(robot, now - self.plan.start):
            counts.cut += 1
        elif self.chance.random() < self.plan.loss:
            counts.lost += 1
        else:
            counts.packets += 1
            counts.bytes += len(packet)
            self.number += 1
            heapq.heappush(self.under_way, (now + self.plan.delay_s, self.number, robot, target, packet))

    def _deliver(self, now: float) -> None:
        while self.under_way and self.under_way[0][0] <= now:
            _, _, robot, target, packet = heapq.heappop(self.under_way)
            if self.plan.cut(robot, now - self.plan.start):
                self.carried[robot].cut += 1
                continue
            try:
                os.write(self.handles[target], packet)
            except OSError:  # a device that is down takes none, and a full one loses it, as any does
                self.carried[robot].lost += 1


def open_device(namespace: str) -> int:
    """A TUN device in a network namespace, as a handle that is read and written packet by packet."""
    libc = ctypes.CDLL(None, use_errno=True)
    here = os.open("/proc/self/ns/net", os.O_RDONLY)
    there = os.open(Path("/run/netns") / namespace, os.O_RDONLY)
    try:
        if libc.setns(there, _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {namespace}")
        handle = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(handle, _TUNSETIFF, struct.pack("16sH22x", DEVICE.encode(), _IFF_TUN | _IFF_NO_PI))
    finally:
        libc.setns(here, _CLONE_NEWNET)
        os.close(here)
        os.close(there)
    return handle


def main() -> None:
    """``NAMESPACE=NAME=ADDRESS`` for each end, one of them named ``fleet``."""
    ends = [argument.split("=") for argument in sys.argv[1:]]
    handles = {name: open_device(namespace) for namespace, name, _ in ends}
    addresses = {IPv4Address(address).packed: name for _, name, address in ends}
    print("open", flush=True)
    wire = Wire(handles, addresses, Plan.parse(sys.stdin.readline()))
    wire.run()
    print(json.dumps({robot: asdict(counts) for robot, counts in wire.carried.items()}), flush=True)


if __name__ == "__main__":
    main()
