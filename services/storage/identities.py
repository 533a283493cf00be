"""Who may do what in the storage: the server everything, a robot read all and write below its own prefix."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.environment.metadata import prefix
from common.files import write_private
from common.objects.embedded import SERVER, credentials_file
from common.objects.settings import Credentials, read_credentials


def make_credentials(directory: Path, robots: Sequence[str]) -> dict[str, Credentials]:
    """The credentials of the server and of each robot; who has some keeps them.

    Raises:
        ConfigurationError: a file of credentials cannot be read, or others may read it.
        OSError: the folder cannot be written to.
    """
    found = {}
    for name in (SERVER, *robots):
        path = credentials_file(directory, name)
        if not path.exists():
            made = Credentials(access_key=f"{name}-{secrets.token_hex(4)}", secret_key=secrets.token_urlsafe(32))
            write_private(path, made.model_dump_json())
        found[name] = read_credentials(path)
    return found


def identities(credentials: dict[str, Credentials], buckets: Sequence[str]) -> dict[str, Any]:
    """SeaweedFS's table of rights."""
    return {"identities": [_identity(name, keys, buckets) for name, keys in credentials.items()]}


def identities_text(credentials: dict[str, Credentials], buckets: Sequence[str]) -> str:
    """The same as the file that SeaweedFS reads."""
    return json.dumps(identities(credentials, buckets), indent=1)


def _identity(name: str, keys: Credentials, buckets: Sequence[str]) -> dict[str, Any]:
    actions = ["Admin"]
    if name != SERVER:
        read = [f"{action}:{bucket}{part}" for bucket in buckets for action in ("Read", "List") for part in ("", "/*")]
        actions = read + [f"Write:{bucket}/{prefix(name)}*" for bucket in buckets]
    return {
        "name": name,
        "credentials": [{"accessKey": keys.access_key, "secretKey": keys.secret_key}],
        "actions": actions,
    }
