"""``vtr odometry``."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from cli.arguments import JsonOption


def odometry(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="A folder of stereo pairs.")],
    *,
    pipeline: Annotated[Literal["stereo"], typer.Option(help="The sensor's pipeline.")] = "stereo",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Poses in KITTI's format, 12 numbers a row.")
    ] = None,
    frames: Annotated[str | None, typer.Option(metavar="SLICE", help="Only these frames, as start:stop:step.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Settings of the pipeline: [estimator] of this robot.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run odometry over a recording, offline: poses, frames a second, and drift where the truth is known."""
    from cli.frames import open_frames
    from cli.offline_settings import stereo_settings
    from cli.output import emit, progress
    from cli.views.offline import check_writable, odometry_figures, poses_text, write
    from services.estimator.offline import measure_drift, run_odometry

    check_writable(output)
    settings = stereo_settings(config)
    recording = open_frames(data, frames, "--frames")
    with progress() as display:
        task = display.add_task(recording.name, total=len(recording))
        run = run_odometry(recording, settings, lambda: display.advance(task))
    truth = recording.poses_truth
    drift = None if truth is None or len(recording) < 2 else measure_drift(run.poses, truth)
    figures = {"recording": recording.name, "pipeline": pipeline, **odometry_figures(run, drift)}
    if output is not None:
        write(output, poses_text(run.poses))
    emit({**figures, "output": None if output is None else str(output)}, _text(figures), as_json=as_json)


def _text(figures: dict[str, Any]) -> str:
    drift, times = figures["drift"], figures["milliseconds"]
    rate = f"{figures['frames_per_second']:.1f} frames a second with reading"
    lines = [
        f"{figures['recording']}: {figures['frames']} frames, {figures['lost']} lost",
        f"{rate}; {times['p50']:.1f} ms a frame without (99 %: {times['p99']:.1f} ms)",
    ]
    if drift is None:
        lines.append("no truth is known")
    else:
        lines.append(
            f"end-point drift {drift['end_point_percent']:.2f} % of {drift['length_m']:.1f} m, "
            f"median error between frames {drift['median_frame_error_m'] * 100:.2f} cm"
        )
    return "\n".join(lines)
