"""``vtr localize``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cli.arguments import JsonOption
from cli.errors import CommandError


def localize(
    teach: Annotated[Path, typer.Argument(metavar="TEACH", help="The recording that is taught.")],
    repeat: Annotated[
        Path | None, typer.Argument(metavar="REPEAT", help="The recording that repeats it; by default the same.")
    ] = None,
    *,
    teach_frames: Annotated[
        str | None, typer.Option(metavar="SLICE", help="Teach these frames only: 0::2 for the even ones.")
    ] = None,
    repeat_frames: Annotated[
        str | None, typer.Option(metavar="SLICE", help="Repeat these frames only: 1::2 for the odd ones.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="FILE.csv: a line a frame; FILE.json: the figures; else KITTI poses."
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Settings of the pipeline: [estimator] of this robot.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Teach one recording and localize another on it, offline: coverage, dropouts, errors."""
    from cli.frames import open_frames
    from cli.offline_settings import stereo_settings
    from cli.output import emit, progress
    from cli.views.offline import check_writable, localization_figures, write_localization
    from services.estimator.offline import run_localization

    check_writable(output)
    settings = stereo_settings(config)
    taught = open_frames(teach, teach_frames, "--teach-frames")
    repeated = open_frames(teach if repeat is None else repeat, repeat_frames, "--repeat-frames")
    with progress() as display:
        task = display.add_task(f"{repeated.name} on {taught.name}", total=len(taught) + len(repeated))
        try:
            run = run_localization(taught, repeated, settings, lambda: display.advance(task))
        except ValueError as error:
            raise CommandError(str(error)) from None
    figures = {"taught": taught.name, "repeated": repeated.name, **localization_figures(run)}
    if output is not None:
        write_localization(output, run, figures)
    emit({**figures, "output": None if output is None else str(output)}, _text(figures), as_json=as_json)


def _text(figures: dict[str, Any]) -> str:
    dropouts = figures["dropouts_m"]
    lines = [
        f"{figures['localized']} of {figures['frames']} frames localized ({100 * figures['coverage']:.1f} %)",
        f"{len(dropouts)} dropouts" + (f", the longest {max(dropouts):.1f} m" if dropouts else ""),
        f"{figures['milliseconds']['p50']:.1f} ms a frame (99 %: {figures['milliseconds']['p99']:.1f} ms)",
    ]
    position, rotation = figures["position_error_m"], figures["rotation_error_deg"]
    if position is not None:
        lines.append(
            f"position error: median {100 * position['median']:.1f} cm, 95 % {100 * position['p95']:.1f} cm, "
            f"max {100 * position['max']:.1f} cm; rotation: median {rotation['median']:.2f}°"
        )
    return "\n".join(lines)
