"""A store in a folder of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from services.mapstore.settings import Settings
from services.mapstore.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    store = Store(tmp_path / "store" / "maps.sqlite", Settings(lock_timeout_s=0.05, checkpoint_mb=0.3, reserve_mb=0))
    yield store
    store.close()
