"""A fleet as deploy/secure says: its server, a robot, an operator and a viewer on loopback, and what strangers need."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from datetime import UTC, datetime, timedelta

from cli.keys.authority import Pair, make_authority, sign
from cli.keys.folder import KeyFolder
from common import config
from common.access.link import client_settings, router_settings
from common.access.names import CommonName, Role
from common.bus import Bus
from common.errors import NoRouter
from common.files import write_private
from common.objects import ObjectStore, StorageError, StorageSettings
from common.objects.embedded import credentials_file
from common.objects.settings import read_credentials
from tests.processes import ROOT, eventually, free_port

SECURE = ROOT / "deploy" / "secure"
_PORTS = ("7447", "7448", "7449", "8333")
ROBOT, OTHER = "robot", "other"


class Machine:
    """A folder with a TOML file of deploy/secure, with free ports, and the processes that run there."""

    def __init__(self, folder, file, ports):
        self.folder = folder
        text = (SECURE / file).read_text(encoding="utf-8").replace("# port = 8333", "port = 8333")
        for default, port in ports.items():
            text = text.replace(default, port)
        for table in ("[robot]", "[server]"):
            text = text.replace(f"{table}\n", f'{table}\ndirectory = "{folder}"\n')
        folder.mkdir(exist_ok=True)
        self.path = folder / file
        self.path.write_text(text, encoding="utf-8")
        self._processes = {}

    @property
    def config(self):
        return config.load(self.path)

    def start(self, service):
        with (self.folder / f"{service}.log").open("ab") as log:
            self._processes[service] = subprocess.Popen(
                [sys.executable, "-m", f"services.{service}"],
                cwd=ROOT,
                stdout=log,
                stderr=log,
                env=os.environ | {"VTR_CONFIG": str(self.path), "OPENBLAS_NUM_THREADS": "1"},
            )

    def kill(self, service):
        self._processes[service].kill()
        self._processes[service].wait()

    def ended(self, service):
        return self._processes[service].poll() is not None

    def log(self, service):
        return (self.folder / f"{service}.log").read_text(encoding="utf-8", errors="replace")

    def bus(self, process, robot=ROBOT, timeout=5.0, **access):
        """A session as the file says; ``access`` replaces parts of how it shows who it is."""
        configuration = self.config
        shown = client_settings(configuration, process)
        for key, value in access.items():
            shown[f"transport/{key}"] = value
        return Bus(robot, process, configuration.bus.endpoint, shared_memory=False, timeout=timeout, access=shown)

    def stop(self):
        for process in self._processes.values():
            process.kill()
            process.wait()


class Fleet:
    """The server with its router and storage, a robot with router, navigator and safety, and people's machines."""

    def __init__(self, folder):
        self.folder = folder
        self._ports = {port: str(free_port()) for port in _PORTS}
        self.spare_port = free_port()
        self.keys = KeyFolder(folder / "server" / "keys")
        self._made = contextlib.ExitStack()
        self.server = self._machine("server", "fleet.toml")
        self.keys.create("test fleet")
        self.keys.issue(Role.SERVER, "central", ["127.0.0.1"], 2)
        self.keys.issue(Role.ROBOT, ROBOT, [], 2)
        self.robot = self._machine("robot", "robot.toml", ROBOT)
        self.operator = self.person(Role.OPERATOR, "alice")
        self.viewer = self.person(Role.VIEWER, "victor")
        self.machines = {
            "operator": self.operator,
            "viewer": self.viewer,
            "other": self.person(Role.ROBOT, OTHER),
            "robot": self._machine("thief", "operator.toml", ROBOT),
        }

    def __enter__(self):
        for service in ("router", "storage"):
            self.server.start(service)
        shutil.copy(self._credentials(ROBOT), self.robot.folder / "credentials.json")
        for service in ("router", "navigator", "safety", "mapstore"):
            self.robot.start(service)
        return self

    def __exit__(self, *_error):
        self._made.close()

    def person(self, role, name):
        """An operator's, a viewer's or another robot's machine, with a certificate of its own."""
        self.keys.issue(role, name, [], 2)
        return self._machine(name, "operator.toml", name)

    def as_(self, who, claims):
        """A session of somebody of this fleet that claims to be a process of the robot."""
        if who == "server":
            return self.server.bus(claims)
        if who in ("tracker", "estimator"):
            password = (self.robot.folder / "keys" / "users" / who).read_text(encoding="utf-8").strip()
            return self.robot.bus(claims, **{"auth/usrpwd": {"user": who, "password": password}})
        return self.machines[who].bus(claims)

    def known_as(self, who):
        """What a router calls somebody."""
        names = {"viewer": "victor", "operator": "alice", "other": OTHER, "robot": ROBOT}
        if who == "server":
            return "Tcp"
        return self.common_name(names[who]) if who in names else who

    def stranger(self, name, pair=None, authority=None):
        """A machine with a certificate and an authority of its own making; without any where none are given."""
        machine = self._machine(name, "operator.toml", "alice")
        for file, text in (
            ("certificate.pem", pair and pair.certificate_pem),
            ("key.pem", pair and pair.key_pem),
            ("ca.pem", authority and authority.certificate_pem),
        ):
            if text is not None:
                write_private(machine.folder / "keys" / file, text)
        return machine

    def signed(self, name, *, days=1.0, ago=timedelta(), authority=None):
        """A certificate of a name, from the fleet's authority or another."""
        own = Pair.load((self.keys.path / "ca.pem").read_bytes(), (self.keys.path / "ca.key").read_bytes())
        return sign(authority or own, CommonName.parse(name), [], days, datetime.now(UTC) - ago)

    def authority(self):
        """An authority that has nothing to do with the fleet's, of the same name."""
        return make_authority("test fleet", datetime.now(UTC))

    def common_name(self, owner):
        return self.keys.register().of(owner)[-1].common_name

    @contextlib.contextmanager
    def conquered_server(self):
        """A router in the server's place that refuses nobody; a session of it that is a robot's process."""
        self.server.kill("router")
        access = router_settings(self.server.config)
        del access["access_control"]
        endpoint = self.server.config.security.listen
        with Bus(ROBOT, "safety", endpoint, shared_memory=False, mode="router", access=access) as bus:
            yield bus

    def storage(self, robot):
        """The storage as a robot reaches it."""
        settings = StorageSettings(
            endpoint=f"https://127.0.0.1:{self._ports['8333']}",
            credentials=self._credentials(robot),
            ca=self.keys.path / "ca.pem",
            connect_s=1.0,
        )
        return ObjectStore(settings, read_credentials(self._credentials(robot)))

    def _machine(self, name, file, keys=None):
        machine = Machine(self.folder / name, file, self._ports)
        self._made.callback(machine.stop)
        if keys is not None:
            shutil.copytree(self.keys.path / keys, machine.folder / "keys")
        return machine

    def _credentials(self, name):
        path = credentials_file(self.server.config.directory, name)
        eventually(path.exists, f"the storage has made the credentials of {name}", 30)
        return path


def refused_at_the_door(machine, **access):
    """Whether no link comes about."""
    try:
        machine.bus("operator", timeout=0.8, **access).close()
    except NoRouter:
        return True
    return False


def answers(storage):
    with contextlib.suppress(StorageError):
        return list(storage.listed("maps", "")) is not None
