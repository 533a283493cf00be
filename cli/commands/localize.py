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
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR|FILE.png",
            help="Pictures of what was localized along the path, and of the distances on dead reckoning.",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Settings of the pipeline: the table estimator of this robot.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Teach one recording and localize another on it, offline: coverage of each stream, dropouts, errors."""
    from cli.frames import open_frames
    from cli.offline_settings import estimator_settings
    from cli.output import emit, progress
    from cli.views.offline import check_writable, localization_figures, write_localization
    from services.estimator.offline import run_localization

    check_writable(output)
    pictures = None if plot is None else _pictures(plot)
    settings = estimator_settings(config)
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
    if pictures is not None:
        from cli.views.localization_plots import plot_localization

        plot_localization(pictures, f"{repeated.name} localized on {taught.name}", run)
    written = {
        "output": None if output is None else str(output),
        "plots": None if pictures is None else [str(path) for path in pictures],
    }
    emit({**figures, **written}, _text(figures), as_json=as_json)


def _pictures(plot: Path) -> tuple[Path, ...]:
    """The files to draw: the one picture that is named, or two in a folder, which is made.

    Raises:
        CommandError: they could not be written.
    """
    from cli.views.offline import check_writable

    if plot.suffix.lower() == ".png":
        check_writable(plot)
        return (plot,)
    try:
        plot.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"--plot: cannot make the folder {plot}: {error.strerror}") from None
    return plot / "localized.png", plot / "dead_reckoning.png"


def _text(figures: dict[str, Any]) -> str:
    dropouts, streams = figures["dropouts_m"], figures["streams"]
    shares = ", ".join(f"{name} {100 * stream['coverage']:.1f} %" for name, stream in streams.items())
    lines = [
        f"{figures['localized']} of {figures['frames']} frames localized ({100 * figures['coverage']:.1f} %)",
        f"by stream: {shares}" if len(streams) > 1 else "the images are grey: the plain stream alone",
        f"{len(dropouts)} dropouts" + (f", the longest {max(dropouts):.1f} m" if dropouts else ""),
        f"{figures['milliseconds']['p50']:.1f} ms a frame (99 %: {figures['milliseconds']['p99']:.1f} ms)",
    ]
    position, rotation = figures["position_error_m"], figures["rotation_error_deg"]
    if position is None:
        lines.append("no truth is known")
    else:
        lines.append(
            f"position error: median {100 * position['median']:.1f} cm, 95 % {100 * position['p95']:.1f} cm, "
            f"max {100 * position['max']:.1f} cm; rotation: median {rotation['median']:.2f}°"
        )
    return "\n".join(lines)
