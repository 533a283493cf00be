"""Fixtures that several folders of tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import structlog
from hypothesis import HealthCheck, settings

if not os.environ.get("CI"):  # where Hypothesis has a profile of its own, without deadlines as well
    settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
    settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def _logs_as_they_come():
    """A command that ran within this process has set its own level; the next test hears everything again."""
    yield
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings; skips where it is missing, and always in CI."""
    if os.environ.get("CI"):
        pytest.skip("real recordings are not used in CI")
    folder = Path(os.environ.get("VTR_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}: set VTR_DATA to the folder that holds them")
    return folder
