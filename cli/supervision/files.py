"""The files of a supervised robot: where they are, and the configuration that ``supervisord`` reads."""

from __future__ import annotations

import hashlib
import re
import shlex
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cli.processes import Process
from common.config import RobotConfig
from common.errors import ConfigurationError

GROUP = "robot"
"""The processes form one group, for supervisor stops groups one after the other, and the members of one at once."""

_SOCKET_PATH_LIMIT = 90
"""A Unix socket's path has 108 bytes on Linux, and supervisor binds it under a longer name first."""

_START_S = 5
_START_RETRIES = 6
_STOP_WAIT_S = 2


@dataclass(frozen=True, slots=True)
class SupervisorFiles:
    """Paths in a robot's directory: ``run/`` for the running supervisor, ``log/`` for what outlives it."""

    run: Path
    log: Path

    @classmethod
    def of(cls, configuration: RobotConfig) -> SupervisorFiles:
        """The files of a robot."""
        directory = configuration.directory.absolute()
        return cls(directory / "run", directory / "log")

    @property
    def configuration(self) -> Path:
        """The generated ``supervisord.conf``."""
        return self.run / "supervisord.conf"

    @property
    def socket(self) -> Path:
        """The socket of supervisor's XML-RPC; in the folder for temporary files where the robot's own is too deep."""
        path = self.run / "supervisor.sock"
        if len(bytes(path)) <= _SOCKET_PATH_LIMIT:
            return path
        return Path(tempfile.gettempdir()) / f"vtr-{hashlib.sha256(bytes(path)).hexdigest()[:16]}.sock"

    @property
    def supervisor_log(self) -> Path:
        """Supervisor's own log, from which restarts are counted."""
        return self.log / "supervisord.log"

    def process_log(self, name: str) -> Path:
        """The log of a process."""
        return self.log / f"{name}.log"

    def make(self) -> None:
        """Makes the folders.

        Raises:
            ConfigurationError: they cannot be made or written to.
        """
        for folder in (self.run, self.log):
            try:
                folder.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=folder):
                    pass
            except OSError as error:
                raise ConfigurationError(
                    f"cannot write to {folder}: {error.strerror}; set 'directory' in [robot] to a folder of yours"
                ) from None


def environment_of(configuration: RobotConfig) -> dict[str, str]:
    """What each process finds in its environment: whose it is, and that mathematics takes no threads of its own."""
    return {"VTR_CONFIG": str(configuration.path), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def render(files: SupervisorFiles, table: Iterable[Process], environment: Mapping[str, str] | None = None) -> str:
    """The text of ``supervisord.conf`` for the processes of a table, with more ``environment`` than supervisor's own.

    How a process that ends is started again: at once, when it had been up for 5 s or more. One that ends sooner is
    tried again after 1 s, then 2 s, and so on up to 6 s; after these six retries supervisor gives up and shows it as
    FATAL, until ``vtr up`` is run anew. A process that always fails later than 5 s after its start is restarted
    without end, at most once in 5 s.

    At the end every process gets SIGTERM at the same time, and SIGKILL, with whatever it had started, 2 s later, so
    that all are gone within 3 s.

    Raises:
        ConfigurationError: a path holds what such a file cannot.
    """
    processes = tuple(table)
    sections = [_daemon(files, environment or {}), *(_program(files, process) for process in processes)]
    sections.append(f"[group:{GROUP}]\nprograms={','.join(process.name for process in processes)}\n")
    return "\n".join(sections)


def _daemon(files: SupervisorFiles, environment: Mapping[str, str]) -> str:
    pairs = ",".join(f'{name}="{_value(text)}"' for name, text in environment.items())
    more = f"environment={pairs}\n" if pairs else ""
    return f"""\
[supervisord]
{more}nodaemon=true
silent=true
logfile={_value(files.supervisor_log)}
logfile_maxbytes=10MB
logfile_backups=3
pidfile={_value(files.run / "supervisord.pid")}
childlogdir={_value(files.log)}

[unix_http_server]
file={_value(files.socket)}
chmod=0700

[rpcinterface:supervisor]
supervisor.rpcinterface_factory=supervisor.rpcinterface:make_main_rpcinterface
"""


def _program(files: SupervisorFiles, process: Process) -> str:
    command = f"{shlex.quote(_value(sys.executable))} -P -m {process.run}"
    return f"""\
[program:{process.name}]
command={command}
autostart=true
autorestart=true
startsecs={_START_S}
startretries={_START_RETRIES}
stopsignal=TERM
stopwaitsecs={_STOP_WAIT_S}
killasgroup=true
redirect_stderr=true
stdout_logfile={_value(files.process_log(process.name))}
stdout_logfile_maxbytes=5MB
stdout_logfile_backups=3
"""


def _value(path: Path | str) -> str:
    """A path as a value of the file: ``%`` begins an expansion there, and `` ;`` or `` #`` a comment."""
    text = str(path)
    if re.search(r"\s[;#]|[\r\n\"]", text):
        raise ConfigurationError(
            f"the supervisor cannot use the path '{text}': it holds ' ;', ' #', a quotation mark or a line break"
        )
    return text.replace("%", "%%")
