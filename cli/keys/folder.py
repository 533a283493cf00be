"""The authority's folder: its certificate and key, the register, and a folder for each whom it issued to.

::

    keys/
      ca.pem  ca.key  register.json
      r1/       ca.pem  certificate.pem  key.pem  users/
      central/  ca.pem  certificate.pem  key.pem
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cli.errors import CommandError
from cli.keys.authority import Pair, hosts_of, make_authority, sign
from common.access.link import make_passwords
from common.access.names import CommonName, Role
from common.access.register import FILE, Entry, Register
from common.files import open_to_others, write_private
from common.ids import is_name
from common.topics import FLEET

CERTIFICATE, KEY, AUTHORITY, USERS = "certificate.pem", "key.pem", "ca.pem", "users"
_AUTHORITY_KEY = "ca.key"
_RESERVED = frozenset({FLEET})


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate, and the folder that holds it with all that its owner needs."""

    entry: Entry
    folder: Path


class KeyFolder:
    """An authority, whose folder one command at a time changes."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def create(self, name: str) -> None:
        """Makes the authority.

        Raises:
            CommandError: there is one already, or the folder cannot be written to.
        """
        if (self.path / AUTHORITY).exists() or (self.path / _AUTHORITY_KEY).exists():
            raise CommandError(f"{self.path} has an authority already: nothing was changed")
        pair = make_authority(name, _now())
        with _writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_private(self.path / _AUTHORITY_KEY, pair.key_pem)
            write_private(self.path / FILE, Register().model_dump_json(indent=1))
            write_private(self.path / AUTHORITY, pair.certificate_pem)

    def issue(self, role: Role, owner: str, hosts: Sequence[str], days: float) -> Issued:
        """A first certificate for somebody, and a robot's passwords.

        Raises:
            CommandError: the name is none, or has a certificate that counts; a server without a host.
        """
        if not is_name(owner) or owner in _RESERVED:
            raise CommandError(f"'{owner}' is no name: use a-z, 0-9, '-' and '_', at most 63 of them, and not 'fleet'")
        if (role is Role.SERVER) != bool(hosts):
            raise CommandError("--host: a server's certificate names its hosts, as robots call it; any other none")
        with self._changing():
            valid = [entry for entry in self.register().of(owner) if entry.counts(_now())]
            if valid:
                raise CommandError(
                    f"{owner} has a certificate until {valid[-1].expires:%Y-%m-%d}: vtr keys renew {owner}"
                )
            return self._issue(role, owner, hosts, days)

    def renew(self, owner: str, days: float, *, revoke: bool) -> Issued:
        """A new certificate and key in the place of the last; the last counts until it expires, or no more at once.

        Raises:
            CommandError: nothing was ever issued to this name, or all of it was revoked.
        """
        with self._changing():
            last = self._last(owner)
            if last.revoked is not None:
                role = last.name.role
                raise CommandError(
                    f"the certificate of {owner} was revoked: vtr keys issue {role} {owner} gives another"
                )
            hosts = hosts_of(self._pair(self.path / owner / CERTIFICATE, self.path / owner / KEY).certificate)
            done = self._issue(last.name.role, owner, hosts, days)
            if revoke:
                self._revoke(lambda entry: entry.name.owner == owner and entry != done.entry)
            return done

    def revoke(self, owner: str) -> list[Entry]:
        """Takes back every certificate of a name that still counts; the fleet's router reads the register.

        Raises:
            CommandError: there is none.
        """
        with self._changing():
            self._last(owner)
            gone = self._revoke(lambda entry: entry.name.owner == owner)
        if not gone:
            raise CommandError(f"no certificate of {owner} counts any more: nothing was changed")
        return gone

    def register(self) -> Register:
        """What was issued.

        Raises:
            CommandError: there is no authority here.
            ConfigurationError: the register cannot be read.
        """
        if not (self.path / AUTHORITY).is_file():
            raise CommandError(f"there is no authority in {self.path}: vtr keys init makes one")
        return Register.read(self.path / FILE)

    def _issue(self, role: Role, owner: str, hosts: Sequence[str], days: float) -> Issued:
        name, folder = CommonName.new(role, owner), self.path / owner
        authority = self._pair(self.path / AUTHORITY, self.path / _AUTHORITY_KEY)
        pair = sign(authority, name, hosts, days, _now())
        entry = Entry(
            common_name=str(name),
            serial=f"{pair.certificate.serial_number:x}",
            expires=pair.certificate.not_valid_after_utc,
        )
        # In the register first: a certificate that nobody knows of could not be revoked.
        self._keep(Register(certificates=(*self.register().certificates, entry)))
        write_private(folder / AUTHORITY, authority.certificate_pem)
        write_private(folder / KEY, pair.key_pem)
        write_private(folder / CERTIFICATE, pair.certificate_pem)
        if role is Role.ROBOT:
            make_passwords(folder / USERS)
        return Issued(entry, folder)

    def _revoke(self, which: Callable[[Entry], bool]) -> list[Entry]:
        now = _now()
        before = self.register().certificates
        gone = [entry for entry in before if which(entry) and entry.counts(now)]
        after = [entry.model_copy(update={"revoked": now}) if entry in gone else entry for entry in before]
        self._keep(Register(certificates=tuple(after)))
        return gone

    def _last(self, owner: str) -> Entry:
        of_owner = self.register().of(owner)
        if not of_owner:
            raise CommandError(f"nothing was issued to '{owner}': vtr keys ls shows to whom")
        return of_owner[-1]

    def _keep(self, register: Register) -> None:
        write_private(self.path / FILE, register.model_dump_json(indent=1))

    def _pair(self, certificate: Path, key: Path) -> Pair:
        try:
            others = open_to_others(key)
            pair = Pair.load(certificate.read_bytes(), key.read_bytes())
        except OSError as error:
            raise CommandError(f"cannot read {error.filename}: {error.strerror}") from None
        except ValueError as error:
            raise CommandError(f"{certificate} and {key} are no certificate and its key: {error}") from None
        if others:
            raise CommandError(f"others may read the private key {key}: chmod 600 it")
        return pair

    @contextlib.contextmanager
    def _changing(self) -> Iterator[None]:
        """One command at a time."""
        self.register()
        with _writing(self.path):
            handle = os.open(self.path, os.O_RDONLY)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX)
                yield
            finally:
                os.close(handle)


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise CommandError(f"cannot write to {error.filename or path}: {error.strerror}") from None


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)
