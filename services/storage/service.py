"""Keeps SeaweedFS running over the server's folder, and says when it answers."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import structlog

from common.errors import RetraverseError
from common.files import write_private
from common.objects import ObjectStore, StorageError
from common.objects.embedded import SERVER
from common.service import Service
from services.storage import weed
from services.storage.audit import Audit
from services.storage.identities import identities_text, make_credentials
from services.storage.robots import Robots
from services.storage.settings import Settings

_POLL_S = 0.1
_READY_S = 30.0
_END_S = 1.0

log = structlog.get_logger()


class StorageFailed(RetraverseError):
    """SeaweedFS did not start, or has ended."""


def main(service: Service) -> None:
    """Serves until the service is stopped; where SeaweedFS ends by itself, so does this process, to be started anew."""
    settings = service.config.settings("storage", Settings)
    directory, base = service.config.directory, service.config.path.absolute().parent
    folder = directory / "storage"
    data = folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    target = settings.reached(directory, base)
    robots = Robots(settings.robots, service.config)
    credentials = make_credentials(directory, robots.names)
    table = folder / "identities.json"
    write_private(table, identities_text(credentials, (target.maps, target.environments)))
    audit = Audit(service, folder)
    service.thread(audit.run, "audit")
    child = weed.start(weed.command(data, table, settings, base, audit.file), folder / "weed.log")
    try:
        _await_answer(service, child, settings, folder / "weed.log")
        _make_buckets(service, child, ObjectStore(target, credentials[SERVER]))
        log.info("the storage is open", endpoint=target.endpoint)
        service.ready()
        while not service.stop.wait(_POLL_S):
            if child.poll() is not None:
                raise StorageFailed(f"SeaweedFS ended with status {child.returncode}: see {folder / 'weed.log'}")
            if robots.changed():
                log.info("ends, to be started anew for other robots")
                return
    finally:
        weed.stop(child, _END_S)


def _await_answer(service: Service, child: subprocess.Popen[bytes], settings: Settings, log_file: Path) -> None:
    end = time.monotonic() + _READY_S
    while not service.stop.wait(_POLL_S):
        if child.poll() is not None or time.monotonic() > end:
            raise StorageFailed(f"SeaweedFS does not serve port {settings.port}: see {log_file}")
        if weed.answers(settings.bind, settings.port):
            return


def _make_buckets(service: Service, child: subprocess.Popen[bytes], store: ObjectStore) -> None:
    """Makes the buckets as soon as the storage takes them: it answers a little before it can."""
    end = time.monotonic() + _READY_S
    while True:
        try:
            store.make_buckets()
        except StorageError:
            if time.monotonic() > end or service.stop.is_set() or child.poll() is not None:
                raise
            service.stop.wait(_POLL_S)
        else:
            return
