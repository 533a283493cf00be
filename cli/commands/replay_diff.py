"""``vtr replay-diff``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import JsonOption
from cli.errors import CommandError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cli.replay.compare import Report
    from services.sensors.recordings.mcap import McapTimeline
    from services.sensors.recordings.timeline import Entry

PARTED = 4
"""Exit code where two runs differ."""


def replay_diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A recording of vtr record: a file, or its folder.")],
    second: Annotated[
        Path | None, typer.Argument(metavar="[B]", help="Another one; by default A's inputs through this version.")
    ] = None,
    *,
    topics: Annotated[
        str | None, typer.Option(metavar="KEYS", help="Only these, as odometry,localization; by default all in both.")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(min=0.0, help="Metres, radians, or part of a number, that count as none.")
    ] = 1e-6,
    ignore: Annotated[
        str | None, typer.Option(metavar="FIELDS", help="Fields that may differ, as inliers,reason.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Keep what the replay said, as an MCAP here.")
    ] = None,
    store: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The map store (maps.sqlite) as it was when A began; or none.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Settings of the replay; by default those in the recording.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show where two recorded runs part, or a recorded run and this version's estimator: exit code 4 where they do."""
    from cli.output import emit
    from cli.replay import compare
    from services.sensors.recordings.mcap import open_mcap

    if second is not None and (output is not None or store is not None or config is not None):
        raise CommandError("--output, --store and --config are those of a replay: leave B out")
    keys, ignored = _names(topics), _names(ignore)
    recording = open_mcap(first.expanduser())
    if second is None:
        pair = _replayed(recording, store, config, output, keys)
    else:
        other = open_mcap(second.expanduser())
        shared = recording.all_counts.keys() & other.all_counts.keys()
        missing = sorted(keys - shared)
        if missing:
            raise CommandError(f"--topics: '{missing[0]}' is not in both recordings")
        pair = compare.entries_of(recording, keys), compare.entries_of(other, keys)
        pair = [e for e in pair[0] if e.key in shared], [e for e in pair[1] if e.key in shared]
    if not pair[0] and not pair[1]:
        raise CommandError("there is nothing to compare: the recordings share no topic of a service")
    report = compare.compare(*pair, tolerance, ignored)
    emit(report.as_dict(), _text(report), as_json=as_json)
    if not report.agree:
        raise typer.Exit(PARTED)


def _replayed(
    recording: "McapTimeline", store: Path | None, config: Path | None, output: Path | None, keys: frozenset[str]
) -> tuple[list["Entry"], list["Entry"]]:
    """What the estimator said then, and what it says now."""
    from cli.output import progress
    from cli.replay import compare, run

    said = keys or frozenset(topic.key for topic in run.OUTPUTS)
    recorded = compare.entries_of(recording, said & recording.all_counts.keys())
    if not recorded:
        raise CommandError(
            f"{recording.name} holds nothing that the estimator said: record {' and '.join(sorted(said))}"
        )
    with run.recorded_configuration(recording, config) as configuration, progress() as display:
        task = display.add_task(recording.name, total=None)
        replayed = run.replay(recording, configuration, store, lambda: display.advance(task))
        if output is not None:
            run.write(replayed, output.expanduser().absolute(), configuration)
    return recorded, [entry for entry in replayed if entry.key in said]


def _names(text: str | None) -> frozenset[str]:
    """The names in a list with commas."""
    return frozenset(name.strip() for name in (text or "").split(",") if name.strip())


def _text(report: "Report") -> "RenderableType":
    from rich.console import Group

    from cli.output import table

    rows: list[tuple[object, ...]] = []
    for key, topic in report.topics.items():
        rows.append((key, f"{topic.both} in both, {topic.only_first} + {topic.only_second} in one", "", "", ""))
        rows += [
            ("", name, f"{found.largest:.3g}", found.count, found.stamp)
            for name, found in topic.fields.items()
            if found.largest > 0.0
        ]
    first = report.first
    said = (
        f"no difference beyond {report.tolerance:g}"
        if first is None
        else f"they part at {first.seconds:.3f} s: {first.topic}, stamp {first.stamp}, {first.field}: "
        f"{first.first} against {first.second}"
    )
    return Group(table("", ("topic", "field", "largest", "messages", "stamp of the largest"), rows), said)
