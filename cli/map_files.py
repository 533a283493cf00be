"""Maps to and from files, by the robot's store on this machine, which another process may have open as well."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cli.errors import CommandError
from common.config import RobotConfig
from common.errors import RetraverseError
from common.messages import GraphQuery, SyncState
from services.mapstore.archive import import_archive, verify, write_archive
from services.mapstore.settings import Settings
from services.mapstore.store import Store

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


@dataclass(frozen=True, slots=True)
class Carried:
    """A map that was written to, or read from, a file."""

    map: str
    vertices: int
    file: str
    bytes: int

    def json(self) -> dict[str, Any]:
        """As JSON holds it."""
        return asdict(self)


def export(configuration: RobotConfig, text: str, output: Path | None) -> Carried:
    """Writes a map, named by enough of its id, to a file.

    Raises:
        CommandError: no map or more than one fits, or the file cannot be written.
        RetraverseError: the store cannot be read, or the map is not finished.
    """
    with _store(configuration, must_exist=True) as store:
        fitting = [
            m for m in store.maps(GraphQuery()).maps if m.record.id.startswith(text) or m.record.id.endswith(text)
        ]
        if len(fitting) != 1 or not text:
            raise CommandError(f"{'more than one map' if fitting else 'no map'} in the store fits '{text}'")
        summary = fitting[0]
        file = (output or Path(f"{summary.record.id}.zip")).expanduser().absolute()
        try:
            archive = write_archive(store, summary.record.id, file)
        except OSError as error:
            raise CommandError(f"cannot write {file}: {error.strerror}") from None
    return Carried(summary.record.id, summary.vertices, str(file), archive.bytes)


def import_all(configuration: RobotConfig, files: Sequence[Path], bar: Progress) -> list[Carried]:
    """Reads maps from files; all are verified before the first is taken.

    Raises:
        CommandError: there is no such file.
        RetraverseError: one of them is not sound, or the store cannot be written.
    """
    missing = [file for file in files if not file.is_file()]
    if missing:
        raise CommandError(f"there is no file {missing[0]}")
    manifests = [verify(file) for file in files]
    done = []
    with _store(configuration, must_exist=False) as store:
        for file, manifest in zip(files, manifests, strict=True):
            task = bar.add_task(file.name, total=manifest.vertices)
            summary = import_archive(store, file, state=SyncState.LOCAL, advance=partial(_show, bar, task))
            done.append(Carried(summary.record.id, summary.vertices, str(file), file.stat().st_size))
    return done


def _show(bar: Progress, task: TaskID, count: int) -> None:
    bar.update(task, completed=count)


@contextlib.contextmanager
def _store(configuration: RobotConfig, *, must_exist: bool) -> Iterator[Store]:
    file = configuration.directory / "store" / "maps.sqlite"
    if must_exist and not file.exists():
        raise CommandError(f"robot '{configuration.robot.name}' has no map store on this machine ({file})")
    store = Store(file, configuration.settings("mapstore", Settings))
    try:
        yield store
    finally:
        with contextlib.suppress(RetraverseError):
            store.close()
