"""What the doctor finds: each thing that can be wrong, alone, makes its own check fail and no other."""

import gzip
import json
import shutil
import socket
import sqlite3
import ssl
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from cli.doctor import machine
from cli.doctor.certificates import check_certificates
from cli.robot import load
from common.access.link import make_passwords
from services.mapstore.schema import MIGRATIONS
from services.sensors.calibration.file import MountingTable, text
from services.sensors.calibration.simulation import simulated_rig
from tests.cli.fake_s3 import FakeS3
from tests.processes import free_port

STORES = Path(__file__).resolve().parents[1] / "data" / "stores"
SHARED = Path("/dev/shm")  # noqa: S108, Linux's place for shared memory
OF_THIS_MACHINE = {"clock", "resources"}
"""What a machine for tests need not have: a time service, and memory to spare."""


@pytest.fixture
def doctor(vtr, write_config):
    """What is not well, by check, of a robot with these tables."""

    def ask(tables="", config=None, endpoint=None):
        path = config or write_config(tables, endpoint)
        result = vtr("doctor", "--config", path, "--json")
        checks = json.loads(result.out)["checks"]
        failed = [check["name"] for check in checks if check["verdict"] == "fail"]
        assert result.code == (1 if failed else 0)
        wrong = [check for check in checks if check["verdict"] != "ok" and check["name"] not in OF_THIS_MACHINE]
        assert all(check["advice"] for check in wrong)
        return {check["name"]: check for check in wrong}

    return ask


def only(wrong, name, verdict, *words):
    assert wrong.keys() == {name}, wrong
    assert wrong[name]["verdict"] == verdict
    for word in words:
        assert word in wrong[name]["text"] + " " + wrong[name]["advice"]


def test_nothing_is_wrong_with_a_robot_that_is_down(doctor):
    assert doctor() == {}


# --- machine ---------------------------------------------------------------------------------------------------------


def test_an_old_python():
    check = machine.check_python((3, 10, 2))
    assert (check.verdict, check.advice) == ("fail", "install Python 3.11 or later")


def test_no_shared_memory(tmp_path):
    check = machine.check_shared_memory(tmp_path / "shm")
    assert check.verdict == "warn"
    assert "shared_memory = false" in check.advice


def test_shared_memory_that_is_full(monkeypatch, doctor):
    usage = shutil.disk_usage
    few = SimpleNamespace(free=1e6)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: few if path == SHARED else usage(path))
    only(doctor(), "shared memory", "warn", "1 MB free")


def test_a_package_that_is_missing(monkeypatch, doctor):
    monkeypatch.setattr(machine.metadata, "requires", lambda _name: ["numpy>=1", "retraverse-wheels>=2"])
    only(doctor(), "dependencies", "fail", "retraverse-wheels>=2 (found none)")


def test_a_clock_from_before_the_installation(monkeypatch):
    monkeypatch.setattr(machine.time, "time", lambda: 1e9)
    assert machine.check_clock().verdict == "fail"


# --- folder and store ------------------------------------------------------------------------------------------------


def test_a_folder_that_cannot_be_written_to(doctor, write_config, tmp_path):
    config = write_config()
    config.write_text(config.read_text().replace(str(tmp_path / "data"), "/proc/retraverse"))
    only(doctor(config=config), "folder", "fail", "/proc cannot be written to")


def test_a_full_disk(doctor, monkeypatch):
    usage = shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(path) if path == SHARED else SimpleNamespace(free=1e8))
    only(doctor(), "folder", "fail", "0.1 GB free", "make room")


@pytest.fixture
def store(tmp_path):
    """A robot's store, of the version before last, or as a test spoils it."""
    file = tmp_path / "data" / "r1" / "store" / "maps.sqlite"
    file.parent.mkdir(parents=True)
    file.write_bytes(gzip.decompress((STORES / "v3.sqlite.gz").read_bytes()))
    return file


def test_a_store_of_an_older_program_is_told_of_and_left_as_it_is(doctor, store):
    before = store.read_bytes()
    only(doctor(), "store", "warn", f"becomes {len(MIGRATIONS)}", "copy it")
    assert store.read_bytes() == before


def test_a_store_of_a_newer_program(doctor, store):
    db = sqlite3.connect(store)
    db.execute("PRAGMA user_version = 99")
    db.close()
    only(doctor(), "store", "fail", "version 99", "update this program")


def test_a_store_that_is_none_or_damaged(doctor, store):
    content = bytearray(store.read_bytes())
    content[8192 * 3 : 8192 * 9] = bytes(8192 * 6)
    store.write_bytes(content)
    only(doctor(), "store", "fail", "malformed", "restore a copy")
    store.write_text("no database at all, only words")
    only(doctor(), "store", "fail", "cannot be read")
    store.unlink()
    db = sqlite3.connect(store)
    db.execute("CREATE TABLE songs (x)")
    db.close()
    only(doctor(), "store", "fail", "another program")


# --- calibration -----------------------------------------------------------------------------------------------------

CAMERAS = '[sensors]\ndriver = "cameras"\n'
CALIBRATED = f'{CAMERAS}calibration = "calibration.toml"\n'


@pytest.fixture
def calibration(tmp_path):
    file = tmp_path / "calibration.toml"
    file.write_text(text(simulated_rig(), MountingTable(position=(0.3, 0.1, 0.8))))
    return file


def test_a_good_calibration(doctor, calibration):
    assert calibration.exists()
    assert doctor(CALIBRATED) == {}


def test_no_calibration(doctor):
    only(doctor(CAMERAS), "calibration", "fail", "names no calibration", "vtr calibrate")
    only(doctor(CALIBRATED), "calibration", "fail", "No such file", "vtr calibrate")


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("fx = 384", "fx = 3840", "see 7 degrees"),
        ("fy = 384", "fy = 584", "square"),
        ("translation = [-0.12", "translation = [-12.0", "apart"),
        ("translation = [-0.12", "translation = [0.12", "exchange"),
    ],
)
def test_a_calibration_that_no_pair_of_cameras_has(doctor, calibration, old, new, word):
    spoilt = calibration.read_text().replace(old, new, 1)
    assert spoilt != calibration.read_text()
    calibration.write_text(spoilt)
    only(doctor(CALIBRATED), "calibration", "fail", word, "calibrate again")


def test_a_mounting_that_nobody_measured(doctor, calibration):
    calibration.write_text(text(simulated_rig(), MountingTable()))
    only(doctor(CALIBRATED), "calibration", "warn", "measure where")


# --- storage ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def sharing(tmp_path):
    """The table of a robot that shares with a storage."""
    credentials = tmp_path / "credentials.json"
    credentials.write_text('{"access_key": "r1", "secret_key": "secret"}')
    credentials.chmod(0o600)
    return lambda endpoint: f'[mapstore.sync]\nendpoint = "{endpoint}"\n'


def test_a_storage_that_is_well(doctor, sharing):
    with FakeS3() as storage:
        assert doctor(sharing(storage.endpoint)) == {}


def test_an_unreachable_storage(doctor, sharing):
    only(doctor(sharing(f"http://127.0.0.1:{free_port()}")), "storage", "fail", "does not answer", "is up")


def test_a_storage_without_conditional_puts(doctor, sharing):
    with FakeS3(conditional=False) as storage:
        only(doctor(sharing(storage.endpoint)), "conditional puts", "fail", "ignores conditional puts")


def test_credentials_that_the_storage_refuses_or_others_may_read(doctor, sharing, tmp_path):
    with FakeS3(status=403) as storage:
        only(doctor(sharing(storage.endpoint)), "storage", "fail", "refuses")
        (tmp_path / "credentials.json").chmod(0o644)
        only(doctor(sharing(storage.endpoint)), "storage", "fail", "chmod 600")


@pytest.mark.parametrize(("ahead", "word"), [(90.0, "behind"), (-90.0, "ahead of")])
def test_a_clock_that_is_off_against_the_fleet(doctor, sharing, ahead, word):
    with FakeS3(ahead=ahead) as storage:
        only(doctor(sharing(storage.endpoint)), "fleet's clock", "fail", word, "time service")


# --- certificates and access -----------------------------------------------------------------------------------------


def certificate(file, begins, ends):
    """A self-signed certificate with its key, valid from and for so many days from now."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "fleet")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + timedelta(days=begins))
        .not_valid_after(now + timedelta(days=ends))
        .sign(key, hashes.SHA256())
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    file.write_bytes(private + made.public_bytes(serialization.Encoding.PEM))
    return file


NAMED = '[mapstore.sync]\nca = "ca.pem"\n'


@pytest.mark.parametrize(
    ("begins", "ends", "verdict", "word"),
    [(-9, -1, "fail", "expired"), (2, 9, "fail", "not valid before"), (-9, 9, "warn", "expires on")],
)
def test_a_certificate_outside_of_its_time(doctor, tmp_path, begins, ends, verdict, word):
    certificate(tmp_path / "ca.pem", begins, ends)
    only(doctor(NAMED), "certificates", verdict, word, "renew")


def test_a_certificate_that_is_well_missing_or_none(doctor, tmp_path):
    certificate(tmp_path / "ca.pem", -9, 90)
    assert doctor(NAMED) == {}
    (tmp_path / "ca.pem").write_text("a love letter")
    only(doctor(NAMED), "certificates", "fail", "no certificate")
    (tmp_path / "ca.pem").unlink()
    only(doctor(NAMED), "certificates", "fail", "cannot be read")


def test_an_expired_certificate_that_a_storage_shows(write_config, sharing, tmp_path):
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(certificate(tmp_path / "server.pem", -9, -1))
    with context.wrap_socket(socket.create_server(("127.0.0.1", 0)), server_side=True) as server:
        threading.Thread(target=_accept, args=(server,), daemon=True).start()
        configuration = load(write_config(sharing(f"https://127.0.0.1:{server.getsockname()[1]}")))
        check = check_certificates(configuration)
    assert check.verdict == "fail"
    assert "expired" in check.text


def _accept(server):
    server.accept()[0].close()


def test_passwords_that_are_missing(doctor):
    only(doctor('[security]\nusers = "users"\n'), "access control", "fail", "cannot read the passwords", "vtr keys")


def test_passwords_that_others_may_read(doctor, tmp_path):
    make_passwords(tmp_path / "users")
    tables = '[security]\nusers = "users"\n'
    assert doctor(tables) == {}
    (tmp_path / "users" / "operator").chmod(0o644)
    only(doctor(tables), "access control", "fail", "others may read the password of operator", "chmod 600")


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:{port}", "tcp/[::]:{port}"])
def test_a_router_without_access_control(doctor, endpoint):
    endpoint = endpoint.format(port=free_port())
    only(doctor(endpoint=endpoint), "access control", "fail", "open to the network", "127.0.0.1")


def test_a_link_to_the_fleet_without_a_certificate(doctor, write_config):
    config = write_config()
    config.write_text(config.read_text() + 'fleet = "tcp/192.0.2.1:7448"\n')
    only(doctor(config=config), "access control", "fail", "192.0.2.1", "tls/")
