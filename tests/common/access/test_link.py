from datetime import UTC, datetime

import pytest

from cli.keys.authority import make_authority
from common import config, topics
from common.access.link import DICTIONARY, client_settings, downsampling, make_passwords, router_settings
from common.errors import ConfigurationError
from common.files import write_private

TLS = '[security]\nca = "ca.pem"\ncertificate = "c.pem"\nkey = "k.pem"\n'
ROBOT = '[robot]\nname = "r1"\n'


@pytest.fixture
def load(tmp_path):
    def load(text):
        for name in ("ca.pem", "c.pem", "k.pem"):
            write_private(tmp_path / name, "pem")
        path = tmp_path / "robot.toml"
        path.write_text(text)
        return config.load(path)

    return load


def test_without_a_table_nothing_is_asked_of_anybody(load):
    plain = load(ROBOT)
    assert router_settings(plain) == {}
    assert client_settings(plain, "safety") == {}


def test_each_process_has_a_password_of_its_own_which_it_keeps(load, tmp_path):
    names = make_passwords(tmp_path / "users")
    configuration = load(f'{ROBOT}[security]\nusers = "users"\n')
    shown = {name: client_settings(configuration, name)["transport/auth/usrpwd"]["password"] for name in names}
    assert len(set(shown.values())) == len(names)
    make_passwords(tmp_path / "users")
    assert client_settings(configuration, "safety")["transport/auth/usrpwd"]["password"] == shown["safety"]
    lines = (tmp_path / "users" / DICTIONARY).read_text().splitlines()
    assert dict(line.split(":") for line in lines) == shown
    assert router_settings(configuration)["transport/auth/usrpwd"] == {
        "dictionary_file": str(tmp_path / "users" / DICTIONARY)
    }


def test_a_process_that_the_topics_do_not_know_has_no_password(load, tmp_path):
    make_passwords(tmp_path / "users")
    with pytest.raises(ConfigurationError, match="cannot read the password of stranger"):
        client_settings(load(f'{ROBOT}[security]\nusers = "users"\n'), "stranger")


def test_a_private_key_that_others_may_read_is_refused(load, tmp_path):
    configuration = load(f'{ROBOT}[bus]\nendpoint = "tls/fleet.example:7449"\n{TLS}')
    (tmp_path / "k.pem").chmod(0o644)
    with pytest.raises(ConfigurationError, match="others may read the private key"):
        client_settings(configuration, "operator")


def test_a_missing_certificate_is_named(load, tmp_path):
    configuration = load(f'{ROBOT}[bus]\nendpoint = "tls/fleet.example:7449"\n{TLS}')
    (tmp_path / "c.pem").unlink()
    with pytest.raises(ConfigurationError, match="there is no certificate"):
        client_settings(configuration, "operator")


def test_a_key_of_another_certificate_is_named(load, tmp_path):
    now = datetime.now(UTC)
    one, other = (make_authority(name, now) for name in ("one", "other"))
    configuration = load(f'{ROBOT}[bus]\nendpoint = "tls/fleet.example:7449"\n{TLS}')
    write_private(tmp_path / "c.pem", one.certificate_pem)
    write_private(tmp_path / "k.pem", other.key_pem)
    with pytest.raises(ConfigurationError, match="are no certificate and its key"):
        client_settings(configuration, "operator")
    write_private(tmp_path / "k.pem", one.key_pem)
    tls = client_settings(configuration, "operator")["transport/link/tls"]
    assert tls["enable_mtls"]
    assert tls["verify_name_on_connect"]
    assert tls["close_link_on_expiration"]


def test_an_encrypted_endpoint_asks_for_certificates(load):
    with pytest.raises(ConfigurationError, match=r"name 'ca', 'certificate' and 'key' in \[security\]"):
        client_settings(load(f'{ROBOT}[bus]\nendpoint = "tls/fleet.example:7449"\n'), "operator")
    with pytest.raises(ConfigurationError, match=r"in \[security\]"):
        router_settings(load(f'{ROBOT}[bus]\nfleet = "tls/fleet.example:7449"\n'))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f'{ROBOT}[security]\nca = "ca.pem"\n', "belong together"),
        (f'{ROBOT}[security]\nlisten = "tls/0.0.0.0:7449"\n', "'listen' and 'members' belong together"),
        (f'{ROBOT}{TLS}listen = "tls/0.0.0.0:7449"\nmembers = "m"\n', "is for the fleet's server"),
        (f'{ROBOT}{TLS}listen = "tcp/0.0.0.0:7449"\nmembers = "m"\n', "security.listen"),
        ('[server]\n[security]\nlisten = "tls/0.0.0.0:7449"\nmembers = "m"\n', "needs 'ca'"),
        (f'[server]\n{TLS}users = "u"\n', "is for a robot"),
        (f'{ROBOT}[security]\npassword = "x"\n', "'security.password' is no setting"),
    ],
)
def test_a_table_that_protects_nothing_is_refused(load, text, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        load(text)


def test_only_images_and_scans_are_held_back_on_their_way_to_the_fleet():
    rules = downsampling("tls", 2.0)
    assert rules["flows"] == ["egress"]
    assert rules["link_protocols"] == ["tls"]
    assert {rule["key_expr"] for rule in rules["rules"]} == {
        topic.at("*", "*") for topic in (topics.STEREO, topics.CAMERA, topics.LIDAR)
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f'{ROBOT}[bus]\nendpoint = "tls/127.0.0.1:7447"\n[security]\n', "for this machine's own processes"),
        ('[server]\n[bus]\nendpoint = "tls/127.0.0.1:7448"\n[security]\n', "for this machine's own processes"),
        ('[server]\n[bus]\nendpoint = "tcp/0.0.0.0:7448"\n[security]\n', "asks nobody who he is"),
        (f'{ROBOT}[bus]\nendpoint = "tcp/[::]:7447"\n[security]\n', "asks nobody who he is"),
        (f'{ROBOT}[bus]\nfleet = "tcp/fleet.example:7448"\n[security]\n', "is not encrypted"),
    ],
)
def test_a_door_that_anybody_may_use_is_refused(load, text, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        router_settings(load(text))


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:7447", "tcp/localhost:7447", "tcp/[::1]:7447", "unixsock-stream/x"]
)
def test_doors_of_this_machine_are_open_to_it(load, endpoint):
    assert router_settings(load(f'{ROBOT}[bus]\nendpoint = "{endpoint}"\n[security]\n'))["access_control"]["enabled"]
