"""Where the camera sits, from figures of eight on the synthetic world's uneven ground, beside the planar way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench import table
from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.file import MountingTable
from services.sensors.calibration.handeye import Segments
from services.sensors.calibration.handeye_start import levelling, planar, vertical
from services.sensors.calibration.mounting import Mounting, mount
from services.sensors.world import World
from services.sensors.world.settings import WorldSettings

Array = NDArray[np.float64]

TRUTH = MountingTable(position=(0.32, 0.11, 0.74), roll=0.02, pitch=0.15, yaw=-0.05)
_SPEED, _TURN, _STEP_S, _STEPS_A_FRAME = 0.7, 0.8, 0.02, 5
_NOISE = np.array([0.001] * 3 + [0.0003] * 3)
"""Of the camera's motion between two frames, metres and radians."""
_DRIVES = 16
_EVERY = 6
"""Frames of a segment of the planar way."""


def main() -> None:
    """Prints a row for each way and number of laps."""
    world = World(WorldSettings())
    rows: list[list[object]] = []
    for laps in (1, 2):
        drives = [_drive(world, laps, seed) for seed in range(_DRIVES)]
        ours = [found for drive in drives if (found := _mounted(*drive)) is not None]
        said = np.array([[*found.place_sigma, found.roll_pitch_sigma, found.yaw_sigma] for found in ours])
        rows.append(_row("ours", laps, [found.T_vehicle_camera for found in ours]))
        rows.append(_row("hand-eye on a plane", laps, [_on_a_plane(*drive) for drive in drives]))
        means = np.sqrt((said**2).mean(axis=0))
        told = [*(1e3 * means[:2]), *np.degrees(means[[2, 2, 3]])]
        rows.append(["what ours says (sigma)", laps, len(ours), *map(float, told)])
    table.show(
        f"mounting from {_DRIVES} figures of eight at as many places, RMS errors",
        ["way", "laps", "drives", "x mm", "y mm", "roll deg", "pitch deg", "yaw deg"],
        rows,
        "wheels that slip, ground that bends, a camera with the noise of odometry; ours refuses what it cannot tell",
    )


def _drive(world: World, laps: int, seed: int) -> tuple[Array, Array]:
    """Motions between frames of the camera (N, 4, 4), and of the wheels (N, 3)."""
    circle, straight = round(2.0 * np.pi / _TURN / _STEP_S), round(0.8 / _STEP_S)
    turns = ([_TURN] * circle + [0.0] * straight + [-_TURN] * circle + [0.0] * straight) * laps
    route = world.scene.demo_route()
    # Another seed is another slip.
    world.settings = replace(world.settings, seed=seed)
    world.place(*(float(value) for value in route[(37 * seed) % len(route)]))
    poses, wheels = [], []
    step = np.eye(4)
    for n, turn in enumerate(turns):
        if n % _STEPS_A_FRAME == 0:
            poses.append(world.T_world_vehicle)
            wheels.append(step)
            step = np.eye(4)
        v, w = world.wheel_odometry()
        step = step @ geometry.from_xy_yaw(v * _STEP_S, 0.0, w * _STEP_S)
        world.step(_STEP_S, (_SPEED, turn))
    T, W, X = np.array(poses), np.array(wheels[1:]), TRUTH.transform()
    noise = geometry.exp(np.random.default_rng(seed).normal(size=(len(T) - 1, 6)) * _NOISE)
    camera = geometry.inverse(X) @ geometry.inverse(T[:-1]) @ T[1:] @ X @ noise
    return camera, np.column_stack([W[:, 0, 3], W[:, 1, 3], np.arctan2(W[:, 1, 0], W[:, 0, 0])])


def _mounted(camera: Array, wheels: Array) -> Mounting | None:
    try:
        return mount(camera, wheels, TRUTH.position[2])
    except CalibrationError:
        return None


def _on_a_plane(camera: Array, wheels: Array) -> Array:
    """The mounting as planar hand-eye calibration has it: turns about one axis, translations across it."""
    pieces = [(k, min(k + _EVERY, len(wheels))) for k in range(0, len(wheels), _EVERY)]
    segments = Segments.of(pieces, camera, wheels, np.zeros(len(pieces), dtype=np.int64))
    up = vertical(segments.turns, segments.steps, np.array([wheels[a:b, 2].sum() for a, b in pieces]))
    level = levelling(up)
    steps = segments.driven(level)[:, :2], (segments.steps @ level.T)[:, :2]
    x, y, yaw, _ = planar(segments.turns @ up, *steps)
    return geometry.transform(geometry.so3_exp([0.0, 0.0, yaw]) @ level, [x, y, TRUTH.position[2]])


def _row(name: str, laps: int, found: list[Array]) -> list[object]:
    errors = []
    for T in found:
        made = MountingTable.of(T)
        place = np.array(made.position[:2]) - TRUTH.position[:2]
        angles = [getattr(made, key) - getattr(TRUTH, key) for key in ("roll", "pitch", "yaw")]
        errors.append([*(1e3 * place), *np.degrees(angles)])
    return [name, laps, len(found), *map(float, np.sqrt((np.array(errors) ** 2).mean(axis=0)))]


if __name__ == "__main__":
    main()
