"""``vtr keys init``, ``issue``, ``renew``, ``revoke``, ``ls``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import JsonOption
from common.access.names import Role

if TYPE_CHECKING:
    from cli.keys.folder import Issued
    from common.access.register import Entry

app = typer.Typer(help="The fleet's certificates: who may join, and as what. docs/security.md shows it step by step.")

DirectoryOption = Annotated[Path, typer.Option("--directory", "-d", help="The authority's folder.")]
DaysOption = Annotated[float, typer.Option("--days", min=0.0001, max=10000, help="For how long it counts.")]
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="A robot's name in its TOML file; else any name.")]
HostOption = Annotated[
    list[str] | None, typer.Option("--host", metavar="HOST", help="A server's name or address, as robots call it.")
]

_DEFAULT = Path("keys")
_DAYS = 365.0
_SOON_DAYS = 30


@app.command()
def init(
    *,
    name: Annotated[str, typer.Option("--name", help="What the authority is called.")] = "retraverse fleet",
    directory: DirectoryOption = _DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Make the authority; its ca.key makes anybody anything, so keep it on no robot."""
    from cli.keys.folder import KeyFolder
    from cli.output import emit

    KeyFolder(directory).create(name)
    emit({"directory": str(directory)}, f"the authority is in {directory}; guard {directory}/ca.key", as_json=as_json)


@app.command()
def issue(
    role: Annotated[Role, typer.Argument(help="What it is for.")],
    name: NameArgument,
    *,
    host: HostOption = None,
    days: DaysOption = _DAYS,
    directory: DirectoryOption = _DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Issue a certificate, into a folder that is copied to its owner's machine as a whole."""
    from cli.keys.folder import KeyFolder

    _report("issued", KeyFolder(directory).issue(role, name, host or [], days), as_json=as_json)


@app.command()
def renew(
    name: NameArgument,
    *,
    days: DaysOption = _DAYS,
    revoke_old: Annotated[bool, typer.Option("--revoke-old", help="The last one counts no more, from now on.")] = False,
    directory: DirectoryOption = _DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Issue a new certificate and key in the last one's place, which counts on until it expires."""
    from cli.keys.folder import KeyFolder

    _report("renewed", KeyFolder(directory).renew(name, days, revoke=revoke_old), as_json=as_json)


@app.command()
def revoke(name: NameArgument, *, directory: DirectoryOption = _DEFAULT, as_json: JsonOption = False) -> None:
    """Take back every certificate of a name; the fleet's router refuses it once it has the new register."""
    from cli.keys.folder import KeyFolder
    from cli.output import emit

    names = [entry.common_name for entry in KeyFolder(directory).revoke(name)]
    text = f"revoked {', '.join(names)}: the fleet's router needs the new {directory}/register.json"
    emit({"revoked": names, "register": str(directory / "register.json")}, text, as_json=as_json)


@app.command()
def ls(*, directory: DirectoryOption = _DEFAULT, as_json: JsonOption = False) -> None:
    """List every certificate with its expiry."""
    from cli.keys.folder import KeyFolder
    from cli.output import emit, table

    data = [_as_json(entry) for entry in KeyFolder(directory).register().certificates]
    rows = [(e["name"], e["role"], e["state"], e["expires"], e["days"], e["common_name"]) for e in data]
    text = table("", ("name", "role", "state", "expires", "days left", "common name"), rows) if rows else "none issued"
    emit({"certificates": data}, text, as_json=as_json)


def _report(done: str, issued: "Issued", *, as_json: bool) -> None:
    from cli.output import emit

    entry = issued.entry
    text = f"{done} {entry.common_name} until {entry.expires:%Y-%m-%d %H:%M} UTC, in {issued.folder}"
    emit({"certificate": _as_json(entry), "folder": str(issued.folder)}, text, as_json=as_json)


def _as_json(entry: "Entry") -> dict[str, object]:
    from datetime import UTC, datetime

    left = (entry.expires - datetime.now(UTC)).total_seconds() / 86400
    state = "revoked" if entry.revoked else "expired" if left <= 0 else "expires soon" if left < _SOON_DAYS else "valid"
    return {
        "name": entry.name.owner,
        "role": entry.name.role.value,
        "state": state,
        "expires": entry.expires.isoformat(),
        "days": round(left, 1),
        "common_name": entry.common_name,
        "serial": entry.serial,
        "revoked": entry.revoked.isoformat() if entry.revoked else None,
    }
