"""What systemd hears of a process: that it is ready, that it lives, and nothing of one that hangs."""

from __future__ import annotations

import os
import socket

import pytest

from common.service_manager import ServiceManager
from tests.processes import eventually


class Listener:
    """The end of the socket that is systemd's."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._socket.settimeout(0.01)
        self.heard: list[str] = []

    def hears(self, line: str) -> bool:
        try:
            while True:
                self.heard.append(self._socket.recv(4096).decode())
        except TimeoutError:
            return line in self.heard

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(tmp_path, monkeypatch):
    listener = Listener(str(tmp_path / "notify"))
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    yield listener
    listener.close()


def test_a_service_says_when_it_is_ready_lives_and_ends(start, manager, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "60000000")
    process = start("service.stop.wait(1); service.ready(); service.stop.wait()")
    eventually(lambda: manager.hears("WATCHDOG=1"), "a sign of life", 30)
    eventually(lambda: manager.hears("READY=1"), "it is ready")
    process.terminate()
    eventually(lambda: manager.hears("STOPPING=1"), "it stops")
    assert process.wait(5) == 0


HANGS = """
service.ready()
with service.stage("frame"):
    pass
print("ready", flush=True)
with service.stage("frame"):
    service.stop.wait()
"""


def test_a_stage_without_an_end_gives_the_watchdog_no_sign_of_life(start, manager, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "1500000")
    process = start(HANGS)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    eventually(lambda: manager.hears("WATCHDOG=1"), "a sign of life while the stage is young", 5)

    def silent() -> bool:
        manager.heard.clear()
        return not any(manager.hears("WATCHDOG=1") for _ in range(150))

    assert eventually(silent, "silence", 15)
    assert process.poll() is None


def test_an_abstract_address_is_understood():
    listener = Listener(f"\0vtr-test-{os.getpid()}")
    ServiceManager({"NOTIFY_SOCKET": f"@vtr-test-{os.getpid()}"}).says("waits\nfor the router")
    assert listener.hears("STATUS=waits for the router")
    listener.close()


@pytest.mark.parametrize(
    "environment",
    [{}, {"NOTIFY_SOCKET": "/nowhere/notify"}, {"NOTIFY_SOCKET": "/nowhere/notify", "WATCHDOG_USEC": "much"}],
)
def test_without_a_manager_nothing_is_said_and_nothing_fails(environment):
    manager = ServiceManager(environment)
    assert manager.watchdog_s is None
    manager.ready()
    manager.alive()
    manager.stopping()


def test_a_watchdog_of_another_process_is_not_ours():
    assert ServiceManager({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "1"}).watchdog_s is None
    assert ServiceManager({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": str(os.getpid())}).watchdog_s == 5.0
