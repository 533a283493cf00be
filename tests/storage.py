"""A real object storage for tests: SeaweedFS with a server's and two robots' credentials."""

from __future__ import annotations

import signal

from common.files import write_private
from common.objects import ObjectStore, StorageError, StorageSettings
from common.objects.embedded import SERVER, credentials_file
from services.storage import weed
from services.storage.identities import identities_text, make_credentials
from services.storage.settings import Settings
from tests.processes import eventually

BUCKETS = ("maps", "environments")


class Storage:
    """A storage that can be killed and started again over the same folder; a context manager."""

    def __init__(self, folder, robots=("r1", "r2")):
        self._directory = folder
        self._port = weed.free_ports(1)[0]
        self._credentials = make_credentials(folder, robots)
        self._table = folder / "storage" / "identities.json"
        write_private(self._table, identities_text(self._credentials, BUCKETS))
        (folder / "storage" / "data").mkdir()
        self._child = None

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_error):
        self.kill()

    @property
    def endpoint(self):
        return f"http://127.0.0.1:{self._port}"

    def start(self):
        folder = self._directory / "storage"
        arguments = weed.command(folder / "data", self._table, Settings(port=self._port), self._directory)
        self._child = weed.start(arguments, folder / "weed.log")
        eventually(self._ready, "the storage takes buckets", 30)

    def kill(self):
        """``kill -9``."""
        if self._child is not None:
            self._child.send_signal(signal.SIGKILL)
            self._child.wait()
            self._child = None

    def settings(self, name, kind=StorageSettings, **fields):
        return kind(
            endpoint=self.endpoint,
            credentials=credentials_file(self._directory, name),
            connect_s=1.0,
            answer_s=5.0,
            **fields,
        )

    def connect(self, name=SERVER):
        return ObjectStore(self.settings(name), self._credentials[name])

    def _ready(self):
        try:
            self.connect().make_buckets()
        except StorageError:
            return False
        return True
