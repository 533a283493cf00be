"""The client of object storage, against a real one: conditions, rights, uploads that go on, and what goes wrong."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from common.environment.metadata import derived_key
from common.errors import ConfigurationError
from common.objects import (
    ObjectStore,
    StorageDenied,
    StorageMissing,
    StorageSettings,
    StorageUnreachable,
    StorageUnsuitable,
    multipart,
)
from common.objects.settings import Credentials, read_credentials
from tests.storage import Storage

BUCKET = "environments"


@pytest.fixture(scope="module")
def storage(tmp_path_factory):
    with Storage(tmp_path_factory.mktemp("server")) as storage:
        yield storage


def test_of_many_who_create_at_once_one_does(storage):
    stores = [storage.connect("r1") for _ in range(12)]
    together = threading.Barrier(12)

    def create(number):
        together.wait()
        return stores[number].create(BUCKET, "robots/r1/race", str(number).encode())

    with ThreadPoolExecutor(12) as pool:
        made = list(pool.map(create, range(12)))
    assert sum(made) == 1
    assert storage.connect().get(BUCKET, "robots/r1/race") == str(made.index(True)).encode()


def test_the_same_again_is_no_conflict(storage):
    store = storage.connect("r1")
    assert store.create(BUCKET, "robots/r1/same", b"content")
    assert store.create(BUCKET, "robots/r1/same", b"content")
    assert not store.create(BUCKET, "robots/r1/same", b"another")


def test_an_unknown_outcome_is_read_back(storage, monkeypatch):
    store = storage.connect("r1")
    request = store.request

    def lost(*arguments, **options):
        request(*arguments, **options)
        raise StorageUnreachable("the answer was lost")

    monkeypatch.setattr(store, "request", lost)
    assert store.create(BUCKET, "robots/r1/unknown", b"content")


@pytest.mark.parametrize("key", ["robots/r2/x", derived_key("park", "model.json"), "x", "robots/r11/x"])
def test_a_robot_writes_below_its_own_prefix_alone(storage, tmp_path, key):
    store, file = storage.connect("r1"), tmp_path / "file"
    file.write_bytes(b"content")
    for bucket in ("maps", BUCKET):
        for write in (
            lambda bucket=bucket: store.put(bucket, key, b"content"),
            lambda bucket=bucket: store.create(bucket, key, b"content"),
            lambda bucket=bucket: multipart.upload(store, bucket, key, file),
        ):
            with pytest.raises(StorageDenied, match="are the credentials right"):
                write()
    with pytest.raises(StorageMissing):
        storage.connect().stat(BUCKET, key)


def test_robots_read_one_another(storage):
    storage.connect("r1").put(BUCKET, "robots/r1/note", b"hello")
    assert storage.connect("r2").get(BUCKET, "robots/r1/note") == b"hello"
    keys = [one.key for one in storage.connect("r2").listed(BUCKET, "robots/r1/", after="robots/r1/n")]
    assert "robots/r1/note" in keys


def test_wrong_secrets_are_refused(storage):
    keys = read_credentials(storage.settings("r1").credentials)
    wrong = ObjectStore(storage.settings("r1"), keys.model_copy(update={"secret_key": "wrong"}))
    for ask in (lambda: wrong.get(BUCKET, "robots/r1/note"), lambda: list(wrong.listed(BUCKET, "robots/"))):
        with pytest.raises(StorageDenied):
            ask()


def test_an_upload_that_was_cut_goes_on_where_it_was(storage, tmp_path, monkeypatch):
    store, file = storage.connect("r1"), tmp_path / "map.zip"
    file.write_bytes(bytes(range(256)) * 50_000)
    sent = []
    send = multipart._send

    def counted(store, bucket, key, upload_id, number, content, tag):
        if len(sent) == 2:
            raise StorageUnreachable("cut")
        sent.append(number)
        send(store, bucket, key, upload_id, number, content, tag)

    monkeypatch.setattr(multipart, "_send", counted)
    with pytest.raises(StorageUnreachable):
        multipart.upload(store, "maps", "robots/r1/map.zip", file)
    with pytest.raises(StorageMissing):
        store.stat("maps", "robots/r1/map.zip")
    monkeypatch.setattr(multipart, "_send", lambda *a: (sent.append(a[4]), send(*a)))
    multipart.upload(store, "maps", "robots/r1/map.zip", file)
    assert sent == [1, 2, 3]
    fetched = tmp_path / "fetched"
    fetched.write_bytes(file.read_bytes()[:7_000_001])
    storage.connect("r2").download("maps", "robots/r1/map.zip", fetched)
    assert fetched.read_bytes() == file.read_bytes()
    assert not list(tmp_path.glob("*.upload"))


def test_a_storage_that_ignores_conditions_is_refused(storage, monkeypatch):
    store = storage.connect("r1")
    store.check_conditional("robots/r1/")
    request = store.request
    monkeypatch.setattr(store, "request", lambda *a, **o: request(*a, **(o | {"headers": {}})))
    with pytest.raises(StorageUnsuitable, match="ignores conditional puts"):
        store.check_conditional("robots/r1/")


def test_nobody_at_the_endpoint_is_said():
    keys = Credentials.model_validate({"access_key": "a", "secret_key": "b"})
    store = ObjectStore(StorageSettings(endpoint="http://127.0.0.1:9"), keys)
    with pytest.raises(StorageUnreachable, match="does not answer"):
        store.get(BUCKET, "x")


@pytest.mark.parametrize(
    ("content", "mode", "words"),
    [('{"access_key": "a"}', 0o600, "secret_key"), ("junk", 0o600, "no credentials"), ("{}", 0o644, "chmod 600")],
)
def test_credentials_that_are_none_are_said(tmp_path, content, mode, words):
    file = tmp_path / "credentials.json"
    file.write_text(content)
    file.chmod(mode)
    with pytest.raises(ConfigurationError, match=words):
        read_credentials(file)
    with pytest.raises(ConfigurationError, match="cannot read"):
        read_credentials(tmp_path / "none.json")
