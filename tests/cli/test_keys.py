"""``vtr keys``, and what its certificates are to a TLS library that is not Zenoh's."""

import json
import ssl
import threading
from datetime import UTC, datetime, timedelta
from socket import socketpair

import pytest
from cryptography import x509

from cli.keys.folder import KeyFolder


@pytest.fixture
def keys(vtr, tmp_path):
    assert vtr("keys", "init").code == 0
    return tmp_path / "keys"


def listed(vtr):
    return json.loads(vtr("keys", "ls", "--json").out)["certificates"]


def test_nothing_of_it_is_readable_for_others(vtr, keys):
    assert vtr("keys", "issue", "robot", "r1").code == 0
    for path in (keys, *keys.rglob("*")):
        assert path.stat().st_mode & 0o077 == 0, path
    assert {p.name for p in (keys / "r1").iterdir()} == {"ca.pem", "certificate.pem", "key.pem", "users"}


def test_a_certificate_says_whose_it_is_and_until_when(vtr, keys):
    done = json.loads(vtr("keys", "issue", "viewer", "bob", "--days", "10", "--json").out)
    entry = done["certificate"]
    assert (entry["name"], entry["role"], entry["state"], entry["days"]) == ("bob", "viewer", "expires soon", 10.0)
    certificate = x509.load_pem_x509_certificate((keys / "bob" / "certificate.pem").read_bytes())
    assert certificate.subject.rfc4514_string() == f"CN={entry['common_name']}"
    assert f"{certificate.serial_number:x}" == entry["serial"]
    assert certificate.not_valid_after_utc == datetime.fromisoformat(entry["expires"])
    assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert "bob" in vtr("keys", "ls").out


def test_a_renewed_certificate_is_another_and_the_last_counts_on_unless_it_is_revoked(vtr, keys):
    vtr("keys", "issue", "server", "central", "--host", "fleet.example", "--host", "10.0.0.1")
    assert vtr("keys", "renew", "central").code == 0
    assert [entry["state"] for entry in listed(vtr)] == ["valid", "valid"]
    assert vtr("keys", "renew", "central", "--revoke-old").code == 0
    assert [entry["state"] for entry in listed(vtr)] == ["revoked", "revoked", "valid"]
    assert len({entry["common_name"] for entry in listed(vtr)}) == 3
    certificate = x509.load_pem_x509_certificate((keys / "central" / "certificate.pem").read_bytes())
    hosts = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert hosts.get_values_for_type(x509.DNSName) == ["fleet.example"]


def test_a_robot_keeps_its_passwords_when_its_certificate_is_renewed(vtr, keys):
    vtr("keys", "issue", "robot", "r1")
    before = (keys / "r1" / "users" / "safety").read_text()
    vtr("keys", "renew", "r1")
    assert (keys / "r1" / "users" / "safety").read_text() == before


@pytest.mark.usefixtures("keys")
def test_what_was_revoked_is_issued_anew_not_renewed(vtr):
    vtr("keys", "issue", "operator", "alice")
    assert "register.json" in vtr("keys", "revoke", "alice").out
    assert vtr("keys", "renew", "alice").sentence.startswith("the certificate of alice was revoked")
    assert vtr("keys", "revoke", "alice").sentence.startswith("no certificate of alice counts any more")
    assert vtr("keys", "issue", "operator", "alice").code == 0
    assert [entry["state"] for entry in listed(vtr)] == ["revoked", "valid"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("issue", "robot", "R1"), "is no name"),
        (("issue", "robot", "../r1"), "is no name"),
        (("issue", "robot", "fleet"), "not 'fleet'"),
        (("issue", "pilot", "r1"), "'pilot' is not one of"),
        (("issue", "server", "central"), "--host: a server's certificate names its hosts"),
        (("issue", "robot", "r1", "--host", "r1.example"), "any other none"),
        (("issue", "server", "central", "--host", "a b"), "'a b' is no host"),
        (("issue", "robot", "r1", "--days", "4000"), "the authority's own certificate ends on"),
        (("issue", "robot", "r1", "--days", "0"), "--days"),
        (("renew", "nobody"), "nothing was issued to 'nobody'"),
        (("revoke", "nobody"), "nothing was issued to 'nobody'"),
        (("init",), "has an authority already"),
        (("ls", "--directory", "elsewhere"), "there is no authority in elsewhere"),
    ],
)
@pytest.mark.usefixtures("keys")
def test_what_cannot_be_done_is_said_in_a_sentence(vtr, arguments, sentence):
    result = vtr("keys", *arguments)
    assert result.code != 0
    assert sentence in result.sentence
    assert listed(vtr) == []


def test_a_second_certificate_for_a_name_is_renewed_not_issued(vtr, keys):
    vtr("keys", "issue", "robot", "r1")
    assert "vtr keys renew r1" in vtr("keys", "issue", "viewer", "r1").sentence
    assert (keys / "r1").is_dir()


@pytest.mark.parametrize("damage", ["loose", "missing", "garbage", "another"])
def test_a_damaged_authority_issues_nothing(vtr, keys, tmp_path, damage):
    key = keys / "ca.key"
    if damage == "loose":
        key.chmod(0o644)
    elif damage == "missing":
        key.unlink()
    elif damage == "garbage":
        key.write_text("no key")
    else:
        KeyFolder(tmp_path / "other").create("another")
        key.write_bytes((tmp_path / "other" / "ca.key").read_bytes())
    assert "ca.key" in vtr("keys", "issue", "robot", "r1").sentence
    assert listed(vtr) == []


def shakes_hands(keys, server, client):
    """Whether two of the fleet's certificates make a TLS connection, the client calling the server by name."""
    ends = []
    for owner, purpose in ((server, ssl.Purpose.CLIENT_AUTH), (client, ssl.Purpose.SERVER_AUTH)):
        context = ssl.create_default_context(purpose, cafile=str(keys / owner / "ca.pem"))
        context.verify_mode = ssl.CERT_REQUIRED
        context.maximum_version = ssl.TLSVersion.TLSv1_2  # where a client's certificate is judged before it is done
        context.load_cert_chain(keys / owner / "certificate.pem", keys / owner / "key.pem")
        ends.append(context)
    one, other = socketpair()
    failed = []

    def serve():
        try:
            ends[0].wrap_socket(one, server_side=True)
        except ssl.SSLError as error:
            failed.append(error)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        ends[1].wrap_socket(other, server_hostname="fleet.example").close()
    except (ssl.SSLError, OSError):
        other.close()
        return False
    finally:
        thread.join()
        one.close()
    return not failed


def test_a_server_serves_and_a_client_asks_and_neither_does_the_other(vtr, keys):
    vtr("keys", "issue", "server", "central", "--host", "fleet.example")
    vtr("keys", "issue", "server", "elsewhere", "--host", "other.example")
    vtr("keys", "issue", "robot", "r1")
    vtr("keys", "issue", "viewer", "bob")
    assert shakes_hands(keys, "central", "r1")
    assert not shakes_hands(keys, "elsewhere", "r1")
    assert not shakes_hands(keys, "bob", "r1")
    assert not shakes_hands(keys, "central", "elsewhere")


def test_two_commands_at_once_lose_nothing(keys):
    folder = KeyFolder(keys)
    threads = [threading.Thread(target=lambda n=n: folder.issue("viewer", f"v{n}", [], 1)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    register = folder.register()
    assert len(register.certificates) == 8
    assert all(entry.expires - datetime.now(UTC) < timedelta(days=1) for entry in register.certificates)
