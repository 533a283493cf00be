"""How a Zenoh session of a robot's process is configured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import zenoh

from common.topics import CAMERA, LIDAR, STEREO

_LEASE_MS = 3000
"""Silence after which a link is given up: a starved process is not a dead one, and one that hangs shows by its data."""

_QUEUES = ("real_time", "interactive_high", "data", "background")
_QUEUE_BATCHES = 16
"""Of 64 kB, for each priority: a receiver that is not scheduled for some milliseconds costs no sample."""

LENDERS = frozenset(owner for topic in (STEREO, CAMERA, LIDAR) for owner in topic.owners)
"""Processes whose samples are worth shared memory: they send frames ten times a second."""


def session_config(
    mode: str,
    endpoint: str,
    *,
    shared_memory: bool,
    lends: bool = False,
    timeout: float | None = None,
    uplink: str | None = None,
    access: Mapping[str, Any] | None = None,
) -> zenoh.Config:
    """Zenoh's configuration of a robot's process: a client of the robot's router, or that router itself.

    A client waits ``timeout`` seconds for the router to appear, without end if that is None; a session that has
    found it once finds it again whenever it is back. A router is linked to the fleet's at ``uplink`` whenever that is
    there, and waits for nothing. ``shared_memory`` is read where others lend it; what ``lends`` puts its own large
    samples there, and whoever reads them keeps 16 MB mapped for each life of the sender, even when that has ended.
    ``access`` is what :mod:`common.access.link` adds for either.
    """
    config = zenoh.Config()
    ends = {"router": ([] if uplink is None else [uplink], [endpoint]), "client": ([endpoint], [])}
    connect, listen = ends[mode]
    settings: dict[str, Any] = {
        "mode": mode,
        "connect/endpoints": connect,
        "listen/endpoints": listen,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": shared_memory,
        "transport/shared_memory/transport_optimization/enabled": shared_memory and lends,
        "timestamping/enabled": True,
        "transport/link/tx/lease": _LEASE_MS,
    }
    settings |= {f"transport/link/tx/queue/size/{priority}": _QUEUE_BATCHES for priority in _QUEUES}
    if mode == "router":
        # Without end, and beside everything else; at 0 one try would be all, and a fleet that comes later never found.
        settings["connect/timeout_ms"] = -1
        settings["connect/exit_on_failure"] = False
        settings["connect/retry"] = {"period_init_ms": 200, "period_max_ms": 4000, "period_increase_factor": 1.5}
    if mode == "client":
        settings["connect/timeout_ms"] = -1 if timeout is None else round(timeout * 1000)
        settings["connect/exit_on_failure"] = timeout is not None
        settings["connect/retry"] = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 1.5}
    for key, value in (settings | dict(access or {})).items():
        config.insert_json5(key, json.dumps(value))
    return config
