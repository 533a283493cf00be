"""The robot's Zenoh router: every process is its client, and it is the only one that listens."""

from __future__ import annotations

from common.service import Service


def main(service: Service) -> None:
    """Routes until it is stopped; Zenoh's own threads do the work."""
    service.ready()
    service.stop.wait()
