"""The embedded storage as a process: it keeps its keys and its data, and nothing of it outlives it."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys

import psutil
import pytest

from common.errors import ConfigurationError
from common.objects import ObjectStore, StorageError, StorageSettings, StorageUnreachable
from common.objects.embedded import SERVER, credentials_file
from common.objects.settings import read_credentials
from tests.processes import eventually, free_port


class Server:
    """A router and the storage over one folder."""

    def __init__(self, folder):
        self.folder = folder
        self.port = free_port()
        self.config = folder / "fleet.toml"
        self.config.write_text(
            f'[server]\ndirectory = "{folder}"\n[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
            f'[storage]\nport = {self.port}\nrobots = ["r1"]\n'
        )
        self.router = self.start("services.router")
        self.storage = self.start("services.storage")

    def start(self, module):
        return subprocess.Popen([sys.executable, "-m", module], env=os.environ | {"VTR_CONFIG": str(self.config)})

    def connect(self, name=SERVER):
        credentials = credentials_file(self.folder / "fleet", name)
        settings = StorageSettings(endpoint=f"http://127.0.0.1:{self.port}", credentials=credentials)
        return ObjectStore(settings, read_credentials(credentials))

    def answers(self):
        with contextlib.suppress(StorageError, ConfigurationError):
            return list(self.connect().listed("maps", "")) is not None

    def child(self):
        return next(iter(psutil.Process(self.storage.pid).children()), None)


@pytest.fixture
def server(tmp_path):
    server = Server(tmp_path)
    yield server
    for process in (server.storage, server.router):
        process.kill()
        process.wait()


def test_a_killed_storage_is_back_with_its_data_and_its_keys(server):
    eventually(server.answers, "the storage answers", 30)
    mode = credentials_file(server.folder / "fleet", "r1").stat().st_mode & 0o777
    assert mode == 0o600
    keys = credentials_file(server.folder / "fleet", "r1").read_text()
    server.connect("r1").put("maps", "robots/r1/one", b"content")
    weed = server.child()
    server.storage.kill()
    server.storage.wait()
    eventually(lambda: not weed.is_running(), "nothing is left of it", 10)
    server.storage = server.start("services.storage")
    eventually(server.answers, "it answers again", 30)
    assert server.connect("r1").get("maps", "robots/r1/one") == b"content"
    assert credentials_file(server.folder / "fleet", "r1").read_text() == keys


def test_it_speaks_tls_with_a_certificate_from_a_file(server):
    server.storage.kill()
    server.storage.wait()
    key, certificate = server.folder / "key.pem", server.folder / "cert.pem"
    command = [
        "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
        "-subj", "/CN=storage", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate,
    ]  # fmt: skip
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed, so no certificate can be made")
    subprocess.run(command, check=True, capture_output=True)
    with server.config.open("a") as config:
        config.write('certificate = "cert.pem"\nkey = "key.pem"\n')
    server.storage = server.start("services.storage")
    credentials = credentials_file(server.folder / "fleet", SERVER)

    def connect(ca):
        endpoint = f"https://127.0.0.1:{server.port}"
        settings = StorageSettings(endpoint=endpoint, credentials=credentials, ca=ca)
        return ObjectStore(settings, read_credentials(credentials))

    def answers():
        with contextlib.suppress(StorageError, ConfigurationError):
            return list(connect(certificate).listed("maps", "")) is not None

    eventually(answers, "the storage answers over TLS", 30)
    with pytest.raises(StorageUnreachable):
        list(connect(None).listed("maps", ""))


def test_the_process_ends_with_what_it_runs(server):
    weed = eventually(server.child, "SeaweedFS runs", 30)
    eventually(server.answers, "the storage answers", 30)
    weed.kill()
    assert server.storage.wait(20) == 1
