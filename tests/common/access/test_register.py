import json
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.access.names import CommonName, Role
from common.access.register import Entry, Register
from common.errors import ConfigurationError
from common.ids import NAME_PATTERN

NOW = datetime(2026, 11, 26, tzinfo=UTC)
owners = st.from_regex(NAME_PATTERN.replace("$", r"\Z"))


@given(st.sampled_from(Role), owners)
def test_a_common_name_is_read_as_it_was_written(role, owner):
    name = CommonName.new(role, owner)
    assert CommonName.parse(str(name)) == name
    assert len(str(name)) < 100


@pytest.mark.parametrize(
    "text", ["", "r1", "robot.r1", "pilot.r1.00aabbcc", "robot.R1.00aabbcc", "robot.r1.00aabbcc.x", "robot..00aabbcc"]
)
def test_what_is_no_common_name(text):
    with pytest.raises(ValueError, match=r"Role|common name"):
        CommonName.parse(text)


def entry(name, **fields):
    return Entry(common_name=name, serial="1f", expires=NOW + timedelta(days=1)).model_copy(update=fields)


def test_what_is_revoked_or_expired_does_not_count():
    register = Register(
        certificates=(
            entry("robot.r1.00000001"),
            entry("robot.r1.00000002", expires=NOW),
            entry("robot.r1.00000003", revoked=NOW),
            entry("viewer.bob.00000004"),
        )
    )
    assert register.common_names(NOW) == {
        Role.ROBOT: {"r1": ["robot.r1.00000001"]},
        Role.VIEWER: {"bob": ["viewer.bob.00000004"]},
    }


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        '{"certificates": [{"common_name": "root", "serial": "1", "expires": "2030-01-01T00:00:00Z"}]}',
        '{"certificates": [{"common_name": "robot.r1.00000001", "serial": "1", "expires": "2030-01-01T00:00:00"}]}',
        json.dumps({"certificates": [], "more": 1}),
    ],
)
def test_a_file_that_is_no_register_is_named(tmp_path, content):
    path = tmp_path / "register.json"
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=r"register\.json is no register"):
        Register.read(path)


def test_a_missing_register_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="cannot read the register"):
        Register.read(tmp_path / "register.json")
