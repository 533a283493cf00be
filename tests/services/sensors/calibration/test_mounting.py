"""A known mounting is recovered from a simulated figure of eight, and drives that cannot tell it are refused."""

import numpy as np
import pytest

from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.file import MountingTable
from services.sensors.calibration.mounting import mount

TRUTH = MountingTable(position=(0.32, -0.06, 0.74), roll=0.03, pitch=0.21, yaw=-0.12)
RATE = 10.0


def eight(laps=2, speed=0.6, turn=0.6):
    """Speeds and turn rates (N, 2) of a figure of eight with straight parts between its two circles."""
    circle = round(2 * np.pi / turn * RATE)
    straight = round(1.0 / speed * RATE)
    lap = [turn] * circle + [0.0] * straight + [-turn] * circle + [0.0] * straight
    return np.array([[speed, w] for w in lap * laps])


def drive(commands, mounting=TRUTH, noise=1.0, scale=1.0, bumps=0.0, slip=0.0, seed=0):
    """Motions of the camera (N, 4, 4) and of the wheels (N, 3) with their noise."""
    rng = np.random.default_rng(seed)
    X = mounting.transform()
    v, w = commands.T / RATE
    # A chord of the arc, at half of its angle.
    chord = v * np.sinc(w / 2 / np.pi)
    xy = np.stack([chord * np.cos(w / 2), chord * np.sin(w / 2)], axis=1)
    A = np.array([geometry.from_xy_yaw(x, y, a) for (x, y), a in zip(xy, w, strict=True)])
    tilt = rng.normal(0.0, bumps, (len(A) + 1, 2))
    rocking = geometry.transform(geometry.so3_exp(np.pad(tilt, ((0, 0), (0, 1)))), np.zeros(3))
    A = geometry.inverse(rocking[:-1]) @ A @ rocking[1:]
    B = geometry.inverse(X) @ A @ X
    B = geometry.exp(rng.normal(0.0, noise, (len(A), 6)) * np.array([0.002] * 3 + [0.0006] * 3)) @ B
    slipped = rng.random(len(A)) < slip
    wheels = np.column_stack([xy, w]) * (1.0 + noise * rng.normal(0.0, 0.02, (len(A), 1))) / scale
    wheels[slipped] *= 2.5
    return B, wheels


def angles(T):
    table = MountingTable.of(T)
    return np.array([table.roll, table.pitch, table.yaw])


def test_without_noise_it_is_exact():
    found = mount(*drive(eight(1), noise=0.0), height=0.74)
    assert np.allclose(found.T_vehicle_camera, TRUTH.transform(), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_with_noise_a_wrong_scale_bumps_and_slip(seed):
    found = mount(*drive(eight(), scale=1.04, bumps=0.003, slip=0.02, seed=seed), height=0.74)
    error = angles(found.T_vehicle_camera) - angles(TRUTH.transform())
    assert np.degrees(np.abs(error)).max() < 0.5
    assert np.abs(found.T_vehicle_camera[:2, 3] - np.array(TRUTH.position[:2])).max() < 0.02
    assert found.wheel_scale == pytest.approx(1.04, abs=0.015)


def test_its_standard_deviations_are_those_of_its_errors():
    errors = []
    for seed in range(40):
        found = mount(*drive(eight(1), seed=seed), height=0.74)
        off = angles(found.T_vehicle_camera) - angles(TRUTH.transform())
        place = found.T_vehicle_camera[:2, 3] - np.array(TRUTH.position[:2])
        errors.append([*(place / found.place_sigma), off[2] / found.yaw_sigma, *(off[:2] / found.roll_pitch_sigma)])
    spread = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert (spread > 0.4).all()
    assert (spread < 2.0).all()


def test_the_height_is_the_one_that_was_measured():
    motions = drive(eight(1))
    low, high = mount(*motions, height=0.2), mount(*motions, height=1.2)
    assert low.T_vehicle_camera[2, 3] == 0.2
    assert np.allclose(low.T_vehicle_camera[:2], high.T_vehicle_camera[:2], atol=3e-3)


def test_a_camera_that_looks_backwards_or_steeply_down():
    for mounting in (MountingTable(position=(-0.2, 0.1, 0.5), yaw=2.9), MountingTable(pitch=1.4, position=(0.5, 0, 1))):
        found = mount(*drive(eight(), mounting), height=mounting.position[2])
        off = geometry.log(geometry.inverse(mounting.transform()) @ found.T_vehicle_camera)
        assert np.degrees(np.linalg.norm(off[3:])) < 0.7
        assert np.linalg.norm(off[:3]) < 0.03


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        (np.tile([0.6, 0.0], (100, 1)), "figure of eight"),
        (np.tile([0.6, 0.5], (300, 1)), "figure of eight"),
        (np.tile([0.0, 0.0], (300, 1)), "figure of eight"),
        (eight(1)[:80], "figure of eight"),
    ],
)
def test_a_drive_that_cannot_tell_is_refused(commands, words):
    with pytest.raises(CalibrationError, match=words):
        mount(*drive(commands))


def test_wheels_that_slip_all_the_time_are_refused():
    camera, wheels = drive(eight())
    spinning = np.random.default_rng(3).random(len(wheels)) < 0.3
    wheels[spinning, :2] *= 3.0
    with pytest.raises(CalibrationError, match="the wheels slip"):
        mount(camera, wheels)


def test_wheels_that_skid_in_every_turn_do_no_harm_and_are_told():
    """A skid-steered base reports more turn than there is; what its camera has turned is what counts."""
    camera, wheels = drive(eight())
    wheels[:, 2] *= 1.3
    found = mount(camera, wheels, height=0.74)
    assert np.degrees(np.abs(angles(found.T_vehicle_camera) - angles(TRUTH.transform()))).max() < 0.5
    assert found.turn_scale == pytest.approx(1 / 1.3, abs=0.02)
    assert any("turns are 1.3" in warning for warning in found.warnings)


def test_a_wrong_sign_of_the_wheels_is_pointed_at():
    camera, wheels = drive(eight())
    assert any("upside down" in warning for warning in mount(camera, wheels * [1, -1, -1]).warnings)
    assert any("backwards" in warning for warning in mount(camera, wheels * [-1, -1, 1]).warnings)


def test_ground_that_is_a_bowl_does_not_tilt_the_camera():
    """Driving in circles on a sphere of 150 m pitches the vehicle as steadily as a camera that looks too far down."""
    commands, radius = eight(1), 150.0
    v, w = commands.T / RATE
    A = geometry.exp(np.column_stack([v, 0 * v, 0 * v, 0 * v, -v / radius, w]))
    X = TRUTH.transform()
    rng = np.random.default_rng(1)
    B = geometry.inverse(X) @ A @ X @ geometry.exp(rng.normal(0.0, 1.0, (len(A), 6)) * ([0.001] * 3 + [0.0003] * 3))
    chord = v * np.sinc(w / 2 / np.pi)
    wheels = np.column_stack([chord * np.cos(w / 2), chord * np.sin(w / 2), w])
    found = mount(B, wheels, height=0.74)
    assert np.degrees(np.abs(angles(found.T_vehicle_camera) - angles(X))).max() < 0.15


def test_too_much_noise_is_refused():
    with pytest.raises(CalibrationError, match="drive longer"):
        mount(*drive(eight(1), noise=15.0, seed=1))


def test_motions_of_two_drives_are_refused():
    camera, wheels = drive(eight(1))
    with pytest.raises(CalibrationError, match="different moments"):
        mount(np.roll(camera, 100, axis=0), wheels)
    with pytest.raises(CalibrationError, match="no match"):
        mount(camera[:-1], wheels)
    camera[5, 0, 0] = np.nan
    with pytest.raises(CalibrationError, match="not finite"):
        mount(camera, wheels)
