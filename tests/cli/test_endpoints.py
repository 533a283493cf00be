"""Endpoints: what is written in [bus] is the socket that is probed."""

import socket

import pytest

from cli.supervision.endpoints import parse
from common.errors import ConfigurationError


@pytest.mark.parametrize(
    ("endpoint", "address"),
    [
        ("tcp/127.0.0.1:7447", ("127.0.0.1", 7447)),
        ("tcp/127.0.0.1:7447#iface=lo", ("127.0.0.1", 7447)),
        ("unixsock-stream//run/robot.sock", "/run/robot.sock"),
    ],
)
def test_an_endpoint_is_parsed(endpoint, address):
    assert parse(endpoint).address == address


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1", "tcp/127.0.0.1:0", "tcp/127.0.0.1:99999", "tcp/:7447", "udp/x:1"]
)
def test_an_endpoint_of_another_form_is_refused(endpoint):
    with pytest.raises(ConfigurationError, match="is no endpoint"):
        parse(endpoint)


def test_a_listening_port_answers_and_is_in_use():
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = parse(f"tcp/127.0.0.1:{server.getsockname()[1]}")
        assert address.answers(1.0)
        with pytest.raises(ConfigurationError, match="in use"):
            address.check_free()
    assert not address.answers(1.0)
    address.check_free()


def test_a_port_whose_last_connection_has_just_ended_is_free():
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = parse(f"tcp/127.0.0.1:{server.getsockname()[1]}")
        client = socket.create_connection(address.address)
        connection, _ = server.accept()
        connection.close()  # the server's side waits in TIME_WAIT
        client.close()
    address.check_free()


def test_the_address_of_another_machine_cannot_be_listened_at():
    with pytest.raises(ConfigurationError, match="cannot listen"):
        parse("tcp/192.0.2.1:7447").check_free()
