"""A robot's configuration of its own for each test, the command line run in this process, and supervised processes."""

import contextlib
import os
from dataclasses import dataclass

import psutil
import pytest

from cli.__main__ import run
from cli.processes import named
from cli.supervision.supervised import Supervised
from tests.processes import free_port


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def sentence(self):
        """The one line that a failed command prints."""
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.err
        return lines[0]


@pytest.fixture
def vtr(capsys, monkeypatch, tmp_path):
    """Runs ``vtr`` with arguments, away from any robot.toml and with a home of its own."""
    monkeypatch.delenv("VTR_CONFIG", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return call


@pytest.fixture
def write_config(tmp_path):
    """Writes a robot's TOML file with a free port and a folder in ``tmp_path``; ``tables`` is more TOML."""

    def write(tables="", endpoint=None):
        path = tmp_path / "robot.toml"
        endpoint = endpoint or f"tcp/127.0.0.1:{free_port()}"
        path.write_text(
            f'[robot]\nname = "r1"\ndirectory = "{tmp_path / "data"}"\n[bus]\nendpoint = "{endpoint}"\n{tables}',
            encoding="utf-8",
        )
        return path

    return write


@pytest.fixture
def supervised(write_config):
    """Makes a :class:`Supervised` of some processes; whatever it leaves behind is killed and fails the test."""
    made = []

    def make(*names):
        made.append(Supervised(write_config(), [named(name) for name in names]))
        return made[-1]

    yield make
    for robot in made:
        robot.stop()
        left = _processes_of(str(robot.config.path))
        for process in left:
            process.kill()
        assert not left, f"still running: {left}"


def _processes_of(config):
    """Processes of a configuration other than this one."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.pid != os.getpid() and process.environ().get("VTR_CONFIG") == config:
                found.append(process)
    psutil.wait_procs(found, timeout=3)
    return [process for process in found if process.is_running() and process.status() != psutil.STATUS_ZOMBIE]
