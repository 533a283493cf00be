"""What ``vtr doctor`` checks of the machine and its clock."""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import sys
import time
from importlib import metadata
from pathlib import Path

import psutil
from packaging.requirements import Requirement

from cli.doctor.check import Check

OLDEST_PYTHON = (3, 11)
WANTED_CORES = 2
WANTED_MEMORY_GB = 2.0
WANTED_SHARED_MB = 128
_TIME_ERROR = 5
_TIMEX_BYTES = 512


def check_python(version: tuple[int, ...] = sys.version_info[:3]) -> Check:
    """Whether this Python is new enough."""
    text = f"{platform.python_implementation()} {'.'.join(map(str, version))}, {platform.system()} {platform.machine()}"
    if version < OLDEST_PYTHON:
        return Check("python", "fail", text, "install Python 3.11 or later")
    return Check("python", "ok", text)


def check_dependencies() -> Check:
    """Whether every package that the distribution needs is there, in a version that it allows."""
    try:
        requirements = [Requirement(text) for text in metadata.requires("retraverse") or ()]
    except metadata.PackageNotFoundError:
        return Check("dependencies", "fail", "retraverse itself is not installed", "pip install -e .")
    wanted = [r for r in requirements if r.marker is None or r.marker.evaluate({"extra": ""})]
    found = {requirement.name: _version(requirement.name) for requirement in wanted}
    wrong = [
        f"{r} (found {found[r.name] or 'none'})"
        for r in wanted
        if found[r.name] is None or not r.specifier.contains(found[r.name] or "", prereleases=True)
    ]
    if wrong:
        return Check("dependencies", "fail", "wanted: " + ", ".join(wrong), "pip install -r requirements.txt")
    return Check("dependencies", "ok", ", ".join(f"{name} {version}" for name, version in sorted(found.items())))


def check_resources() -> Check:
    """Whether there are cores and memory enough for a robot's processes."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = psutil.virtual_memory().available / 1e9
    text = f"{cores} cores, {memory:.1f} GB of memory free"
    if cores < WANTED_CORES or memory < WANTED_MEMORY_GB:
        advice = f"a robot with its camera wants {WANTED_CORES} cores and {WANTED_MEMORY_GB:.0f} GB"
        return Check("resources", "warn", text, advice)
    return Check("resources", "ok", text)


def check_shared_memory(folder: Path = Path("/dev/shm")) -> Check:  # noqa: S108, Linux's place for shared memory
    """Whether frames can travel through shared memory."""
    advice = "enlarge /dev/shm (docker: --shm-size=512m), or set 'shared_memory = false' in [bus]"
    try:
        free = shutil.disk_usage(folder).free / 1e6
    except OSError as error:
        return Check("shared memory", "warn", f"{folder}: {error.strerror}", advice)
    text = f"{free:.0f} MB free in {folder}"
    if free < WANTED_SHARED_MB or not os.access(folder, os.W_OK):
        return Check("shared memory", "warn", text, advice)
    return Check("shared memory", "ok", text)


def check_clock() -> Check:
    """Whether the clock is plausible, and set by a time service."""
    now = time.time()
    text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now))
    if now < Path(__file__).stat().st_mtime:
        return Check("clock", "fail", f"{text} is before this software was installed", "set the clock")
    if not _clock_synchronized():
        advice = "run a time service (chrony, systemd-timesyncd), for maps are told apart and chosen by their time"
        return Check("clock", "warn", f"{text}, set by no time service", advice)
    return Check("clock", "ok", f"{text}, set by a time service")


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _clock_synchronized() -> bool:
    """Whether Linux's kernel says that a time service keeps its clock; True where nobody can tell."""
    if sys.platform != "linux":
        return True
    timex = ctypes.create_string_buffer(_TIMEX_BYTES)  # all zero: asks, and sets nothing
    return int(ctypes.CDLL(None).adjtimex(timex)) != _TIME_ERROR
