from datetime import UTC, datetime, timedelta

import pytest

from common.access.register import Entry, Register
from common.errors import ConfigurationError
from services.storage.robots import robots_of

NOW = datetime.now(UTC)


def test_robots_with_a_certificate_may_write_and_those_that_lost_it_may_not(tmp_path):
    def entry(name, **fields):
        return Entry(common_name=name, serial="1", expires=NOW + timedelta(days=1), **fields)

    path = tmp_path / "register.json"
    certificates = (
        entry("robot.r1.00000001"),
        entry("robot.r2.00000002", revoked=NOW),
        entry("robot.r3.00000003", revoked=NOW),
        entry("robot.r3.00000004"),
        entry("viewer.bob.00000005"),
    )
    path.write_text(Register(certificates=certificates).model_dump_json())
    assert robots_of(["r2", "by-hand"], path) == ["by-hand", "r1", "r3"]
    assert robots_of(["r2"], None) == ["r2"]


def test_a_broken_register_gives_nobody_anything(tmp_path):
    with pytest.raises(ConfigurationError):
        robots_of([], tmp_path / "register.json")
