"""Who may use the console."""

import pytest

from common.errors import ConfigurationError
from services.console.guard import Guard, Guesses, read_token, session_secret
from services.console.settings import Settings

SECRET = b"s" * 32
TOKEN = "0123456789abcdef"  # noqa: S105, of this test alone
EVERYWHERE = "0.0.0.0"  # noqa: S104, that is the point


def test_beyond_loopback_a_token_is_demanded():
    with pytest.raises(ValueError, match="token_file"):
        Settings(host=EVERYWHERE)
    assert not Settings(host=EVERYWHERE, token_file="x").is_local  # noqa: S106, a file's name
    for host in ("127.0.0.1", "localhost", "::1", "127.0.0.2"):
        assert Settings(host=host).is_local


def test_an_origin_is_no_page():
    with pytest.raises(ValueError, match="origins"):
        Settings(origins=("https://ops.example/page",))


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("127.0.0.1:8180", True),
        ("localhost:9000", True),
        ("[::1]:8180", True),
        ("evil.example:8180", False),
        ("", False),
    ],
)
def test_without_a_token_the_console_answers_to_its_own_name_alone(host, allowed):
    assert Guard(None, SECRET).allows_host(host) is allowed
    assert Guard(TOKEN, SECRET).allows_host(host)


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (None, True),
        ("http://robot:8180", True),
        ("https://robot:8180", True),
        ("https://ops.example", True),
        ("http://robot", False),
        ("http://robot:8181", False),
        ("http://evil.example", False),
        ("null", False),
        ("file://robot:8180", False),
    ],
)
def test_pages_of_other_origins_may_not(origin, allowed):
    guard = Guard(TOKEN, SECRET, origins=frozenset({"https://ops.example"}))
    assert guard.allows_origin(origin, "robot:8180") is allowed


def test_a_session_is_worth_what_its_token_is():
    guard = Guard(TOKEN, SECRET)
    assert guard.knows_token(TOKEN)
    assert not guard.knows_token(TOKEN + "0")
    assert guard.knows_session(guard.session())
    assert not guard.knows_session("")
    assert not Guard(TOKEN + "0", SECRET).knows_session(guard.session())
    assert not Guard(TOKEN, b"t" * 32).knows_session(guard.session())


def test_each_wrong_token_costs_twice_the_time_of_the_one_before():
    guesses, now, waits = Guesses(), 100.0, []
    for _ in range(9):
        guesses.wrong("10.0.0.1", now)
        waits.append(guesses.wait("10.0.0.1", now))
        now += waits[-1]
        assert guesses.wait("10.0.0.1", now) == 0.0
    assert waits == pytest.approx([0.5, 1, 2, 4, 8, 16, 30, 30, 30])
    assert guesses.wait("10.0.0.2", now) == 0.0
    guesses.wrong("10.0.0.1", now)
    guesses.right("10.0.0.1")
    assert guesses.wait("10.0.0.1", now) == 0.0


def test_a_token_is_its_owners_alone(tmp_path):
    file = tmp_path / "token"
    with pytest.raises(ConfigurationError, match="openssl"):
        read_token(file)
    file.write_text(TOKEN + "\n")
    file.chmod(0o644)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        read_token(file)
    file.chmod(0o600)
    assert read_token(file) == TOKEN
    file.write_text("short")
    with pytest.raises(ConfigurationError, match="characters"):
        read_token(file)


def test_sessions_outlive_the_console(tmp_path):
    file = tmp_path / "run" / "secret"
    secret = session_secret(file)
    assert session_secret(file) == secret
    assert file.stat().st_mode & 0o077 == 0
    file.write_bytes(b"torn")
    assert len(session_secret(file)) == 32


def test_half_a_certificate_is_none():
    with pytest.raises(ValueError, match="private_key"):
        Settings(certificate="console.crt")
    assert Settings(certificate="a", private_key="b").address == "https://127.0.0.1:8180"
