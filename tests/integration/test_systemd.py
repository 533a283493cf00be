"""The units under a systemd of their own: started when ready, and a process that hangs killed and started anew.

It is a user's instance in a mount namespace whose ``/run`` says that systemd has booted, which takes root and Linux.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cli.__main__ import run
from tests.processes import ROOT, eventually, free_port

SYSTEMD = Path("/lib/systemd/systemd")
HIERARCHIES = [Path("/sys/fs/cgroup/systemd"), Path("/sys/fs/cgroup/unified"), Path("/sys/fs/cgroup")]
NOT_FOR_A_USER = ("User=", "LogNamespace=", "CapabilityBoundingSet=", "Protect", "ReadWritePaths=")
"""What only the machine's own systemd may set, or can in whatever container the tests run in."""

BOOT = """
for procs in {procs}; do echo $$ > $procs; done
mount -t tmpfs tmpfs /run && mkdir -p /run/systemd/system /run/user-1 && chmod 700 /run/user-1
export XDG_RUNTIME_DIR=/run/user-1
exec {systemd} --user
"""


class Manager:
    """A systemd over units in ``folder``; commands enter its namespaces."""

    def __init__(self, folder):
        self._cgroups = [base / f"vtr-test-{os.getpid()}" for base in HIERARCHIES if (base / "cgroup.procs").exists()]
        for cgroup in self._cgroups:
            cgroup.mkdir()
        procs = " ".join(str(cgroup / "cgroup.procs") for cgroup in self._cgroups)
        script = BOOT.format(procs=procs, systemd=SYSTEMD)
        environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"),
                       "XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(ROOT)}  # fmt: skip
        self._process = subprocess.Popen(
            ["unshare", "--mount", "--propagation", "private", "sh", "-c", script],
            env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def ask(self, *arguments):
        enter = ["nsenter", f"--target={self._process.pid}", "--mount", "env", "XDG_RUNTIME_DIR=/run/user-1"]
        done = subprocess.run(
            [*enter, "systemctl", "--user", *arguments], capture_output=True, text=True, timeout=60, check=False
        )
        return done.stdout.strip()

    def runs(self):
        assert self._process.poll() is None
        return self.ask("is-system-running") in {"running", "degraded"}

    def show(self, unit, name):
        return self.ask("show", "--property", name, "--value", unit)

    def pid(self, unit):
        return int(self.show(unit, "MainPID"))

    def close(self):
        self._process.terminate()
        self._process.wait(20)
        for cgroup in self._cgroups:
            for folder in sorted(cgroup.glob("**/"), reverse=True):
                with contextlib.suppress(OSError):
                    folder.rmdir()


@pytest.fixture
def manager(tmp_path):
    if os.geteuid() != 0 or not SYSTEMD.exists() or shutil.which("unshare") is None:
        pytest.skip("it takes root, systemd and namespaces to run a systemd of one's own")
    units = tmp_path / "config" / "systemd" / "user"
    config = tmp_path / "robot.toml"
    config.write_text(
        f'[robot]\nname = "r1"\ndirectory = "{tmp_path / "data"}"\n[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
    )
    assert run(["deploy", "systemd", str(config), "-o", str(units), "--python", sys.executable]) == 0
    template = units / "retraverse-robot@.service"
    lines = [line for line in template.read_text().splitlines() if not line.startswith(NOT_FOR_A_USER)]
    lines.insert(lines.index("[Service]") + 1, f"Environment=PYTHONPATH={ROOT}")
    template.write_text("\n".join(lines) + "\n")
    limits = units / "retraverse-robot@safety.service.d" / "limits.conf"
    limits.write_text(limits.read_text().replace("WatchdogSec=5", "WatchdogSec=2"))
    try:
        booted = Manager(tmp_path)
    except OSError:
        pytest.skip("no control group can be made here")
    try:
        eventually(booted.runs, "systemd has booted", 10)
    except AssertionError:
        booted.close()
        pytest.skip("no systemd boots here")
    yield booted
    booted.close()


def test_units_are_up_when_ready_and_a_process_that_hangs_is_started_anew(manager):
    router, safety = "retraverse-robot@router", "retraverse-robot@safety"
    manager.ask("start", router, safety)
    assert manager.show(router, "ActiveState") == manager.show(safety, "ActiveState") == "active"
    hung = manager.pid(safety)
    assert hung > 1
    os.kill(hung, signal.SIGSTOP)
    eventually(lambda: manager.pid(safety) not in {0, hung}, "safety is started anew", 30)
    eventually(lambda: manager.show(safety, "ActiveState") == "active", "safety is ready again", 30)
    assert manager.show(safety, "NRestarts") == "1"
    assert manager.show(router, "NRestarts") == "0"
    manager.ask("stop", router, safety)
    assert manager.show(safety, "Result") == "success"
