"""A robot's sharing as a process of its own, to be killed: ``python -m tests.services.mapstore.sync.worker FILE``."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

from common.errors import NoAnswer
from common.messages import FetchRequest
from common.objects import multipart
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from services.mapstore.sync.engine import Syncer
from services.mapstore.sync.settings import SyncSettings


def main(file):
    """Shares what there is and fetches what is named, until it is killed."""
    told = json.loads(Path(file).read_text())
    folder = Path(told["folder"])
    count_parts(folder / "sent")
    store = Store(folder / "maps.sqlite", Settings(reserve_mb=0))
    settings = SyncSettings(
        endpoint=told["endpoint"], credentials=Path(told["credentials"]), retry_s=0.3, connect_s=1.0, answer_s=3.0
    )
    stop = threading.Event()
    syncer = Syncer(lambda: store, settings, told["robot"], folder / "sync", folder, nobody_listens, stop)
    for work in (syncer.upload, syncer.fetch):
        threading.Thread(target=work, daemon=True).start()
    # A map that its robot has not shared yet is asked for again, as a planner does.
    while not stop.wait(0.3):
        syncer.want(FetchRequest(environment="yard", maps=told["fetch"]))


def count_parts(file):
    """Writes a line for each part that is sent."""
    send = multipart._send

    def counted(store, bucket, key, upload_id, number, content, tag):
        with file.open("a") as out:
            out.write(f"{key} {number}\n")
        send(store, bucket, key, upload_id, number, content, tag)

    multipart._send = counted


def nobody_listens(_announcement):
    """There is no server."""
    raise NoAnswer("there is no server")


if __name__ == "__main__":
    main(sys.argv[1])
