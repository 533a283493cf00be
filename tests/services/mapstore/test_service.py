"""The service's hold on its store."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.messages import GraphQuery
from services.mapstore.errors import StoreError
from services.mapstore.service import Keeper
from services.mapstore.settings import Settings
from tests.services.mapstore.graphs import drive


def test_a_store_that_cannot_be_opened_is_tried_again_at_each_question(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    file.write_bytes(b"no database" * 1000)
    keeper = Keeper(file, Settings(reserve_mb=0))
    for _ in range(2):
        with pytest.raises(StoreError, match="damaged"):
            keeper.store()
    keeper.tidy()
    file.unlink()
    keeper.store().commit(drive(0, 1)[0])
    assert keeper.store().maps(GraphQuery()).maps[0].vertices == 1
    keeper.tidy()
    keeper.close()
