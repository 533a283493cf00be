"""``vtr odometry``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from cli.arguments import JsonOption

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from services.estimator.offline import OdometryRun


def odometry(
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="A folder of stereo pairs or of lidar scans, or an Ouster's .pcap.")
    ],
    *,
    pipeline: Annotated[
        Literal["stereo", "lidar"] | None, typer.Option(help="The sensor's pipeline; by default what the folder holds.")
    ] = None,
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
    from cli.output import emit
    from cli.views.offline import check_writable, odometry_figures, poses_text, write
    from services.estimator.offline import measure_drift
    from services.sensors.recordings import is_lidar_recording

    check_writable(output)
    chosen = pipeline or ("lidar" if is_lidar_recording(data) else "stereo")
    run, name, poses_truth, truth = (_lidar if chosen == "lidar" else _stereo)(data, frames, config)
    drift = None if poses_truth is None or len(run.poses) < 2 else measure_drift(run.poses, poses_truth)
    figures = {"recording": name, "pipeline": chosen, **odometry_figures(run, drift, truth)}
    if output is not None:
        write(output, poses_text(run.poses))
    emit({**figures, "output": None if output is None else str(output)}, _text(figures), as_json=as_json)


def _stereo(
    data: Path, frames: str | None, config: Path | None
) -> tuple["OdometryRun", str, "NDArray[np.float64] | None", str]:
    """The run, the recording's name, its true poses, and what these are."""
    from cli.frames import open_frames
    from cli.offline_settings import stereo_settings
    from cli.output import progress
    from services.estimator.offline import run_odometry

    settings = stereo_settings(config)
    recording = open_frames(data, frames, "--frames")
    with progress() as display:
        task = display.add_task(recording.name, total=len(recording))
        run = run_odometry(recording, settings, lambda: display.advance(task))
    return run, recording.name, recording.poses_truth, "truth"


def _lidar(
    data: Path, frames: str | None, config: Path | None
) -> tuple["OdometryRun", str, "NDArray[np.float64] | None", str]:
    """As :func:`_stereo`."""
    from cli.frames import open_lidar_frames
    from cli.offline_settings import lidar_settings
    from cli.output import progress
    from services.estimator.offline import run_lidar_odometry

    settings = lidar_settings(config)
    recording = open_lidar_frames(data, frames, "--frames")
    with progress() as display:
        task = display.add_task(recording.name, total=len(recording))
        run = run_lidar_odometry(recording, settings, lambda: display.advance(task))
    return run, recording.name, recording.poses_truth, recording.truth


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
            f"against the {drift['against']}: end-point drift {drift['end_point_percent']:.2f} % of "
            f"{drift['length_m']:.1f} m and {drift['end_rotation_deg']:.2f} degrees, "
            f"median error between frames {drift['median_frame_error_m'] * 100:.2f} cm"
        )
    return "\n".join(lines)
