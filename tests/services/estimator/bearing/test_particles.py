"""The particle filter on similarity curves of which the answer is known."""

import numpy as np
import pytest

from services.estimator.bearing.particles import ParticleFilter
from services.estimator.bearing.settings import ParticleSettings
from services.estimator.bearing.window import TaughtPath, Window

SPACING, LENGTH = 0.4, 20.0
METRES = np.arange(0.0, LENGTH + 1e-9, SPACING)
CURVED = TaughtPath(METRES, 0.5 * np.sin(METRES / 4.0), np.ones(len(METRES) - 1))
STEP, COUNT = 0.01, 101
NOISE = 0.03


def window_at(metres, offset, rng, path=CURVED, noise=NOISE):
    """What images around a robot would say: a peak at each one's own shift, the higher the nearer the image."""
    near = np.flatnonzero(np.abs(path.metres - metres) < 3.0)
    shifts = (np.arange(COUNT) - COUNT // 2) * STEP
    expected = offset + np.interp(metres, path.metres, path.yaw) - path.yaw[near]
    height = 0.6 * np.exp(-0.5 * ((path.metres[near] - metres) / 1.2) ** 2)
    curves = height[:, None] * np.exp(-0.5 * ((shifts - expected[:, None]) / 0.04) ** 2)
    return Window(path.metres[near], path.yaw[near], curves + noise * rng.standard_normal(curves.shape), STEP, 1.0)


def weigh(particles, window, metres, path=CURVED):
    headings = path.yaw_at(particles.metres) + particles.heading
    particles.weigh(window.similarity(particles.metres, headings), metres)


def drive(particles, metres, offset, rng, *, frames=80, step=0.1, slip=0.0):
    """A drive along the curve at one offset of the heading; the wheels count ``slip`` too much. The true distance."""
    for _ in range(frames):
        turn = float(np.diff(CURVED.yaw_at(np.array([metres, metres + step])))[0])
        metres += step
        particles.predict(step * (1.0 + slip), turn, CURVED.yaw_at)
        weigh(particles, window_at(metres, offset, rng), step)
    return metres


@pytest.mark.parametrize(("metres", "offset"), [(3.1, 0.0), (6.0, 0.12), (9.7, -0.2)])
def test_a_search_finds_distance_and_shift_in_one_image(metres, offset):
    rng = np.random.default_rng(1)
    window = window_at(metres, offset, rng)
    grid, offsets = np.arange(metres - 2.5, metres + 2.5, 0.1), np.arange(-0.4, 0.4, 0.01)
    s, h = (part.ravel() for part in np.meshgrid(grid, offsets, indexing="ij"))
    particles = ParticleFilter()
    particles.spread(grid, offsets, window.similarity(s, CURVED.yaw_at(s) + h).reshape(len(grid), len(offsets)))
    found = particles.estimate()
    assert found.metres == pytest.approx(metres, abs=0.3)
    assert found.heading == pytest.approx(offset, abs=0.04)
    assert found.sigmas[0] < 0.5


def test_it_follows_a_known_drive():
    rng, particles = np.random.default_rng(2), ParticleFilter()
    particles.start(2.0, 0.1, (0.1, 0.02))
    metres = drive(particles, 2.0, 0.1, rng)
    found = particles.estimate()
    assert found.metres == pytest.approx(metres, abs=0.2)
    assert found.heading == pytest.approx(0.1, abs=0.03)
    assert abs(found.metres - metres) < 4.0 * found.sigmas[0]


@pytest.mark.parametrize("wrong", [-1.5, 1.5])
def test_it_converges_from_a_wrong_start(wrong):
    rng, particles = np.random.default_rng(3), ParticleFilter()
    particles.start(4.0 + wrong, -0.15, (1.0, 0.2))
    metres = drive(particles, 4.0, 0.0, rng)
    found = particles.estimate()
    assert found.metres == pytest.approx(metres, abs=0.25)
    assert found.heading == pytest.approx(0.0, abs=0.03)


def test_wheels_that_slip_are_corrected_by_the_images():
    rng, particles = np.random.default_rng(4), ParticleFilter()
    particles.start(2.0, 0.0, (0.1, 0.02))
    metres = drive(particles, 2.0, 0.0, rng, frames=120, slip=0.05)
    assert particles.estimate().metres == pytest.approx(metres, abs=0.3)


def test_without_images_it_knows_less_the_further_it_drives():
    particles = ParticleFilter()
    particles.start(2.0, 0.0, (0.05, 0.01))
    sigmas = []
    for _ in range(3):
        for _ in range(20):
            particles.predict(0.1, 0.0, np.zeros_like)
        sigmas.append(particles.estimate().sigmas)
    assert np.all(np.diff(np.array(sigmas), axis=0) > 0.0)


def test_a_turn_that_was_taught_there_changes_no_offset_and_one_that_was_not_does():
    settings = ParticleSettings(distance_noise=1e-6, heading_noise=1e-6)
    particles = ParticleFilter(settings)
    particles.start(4.0, 0.0, (1e-6, 1e-6))
    taught = float(np.diff(CURVED.yaw_at(np.array([4.0, 5.0])))[0])
    particles.predict(1.0, taught, CURVED.yaw_at)
    assert particles.estimate().heading == pytest.approx(0.0, abs=1e-4)
    particles.predict(0.0, 0.2, CURVED.yaw_at)
    assert particles.estimate().heading == pytest.approx(0.2, abs=1e-4)


def test_a_robot_that_stands_does_not_become_surer_by_looking_again():
    rng, particles = np.random.default_rng(5), ParticleFilter()
    particles.start(5.0, 0.0, (0.5, 0.1))
    before = particles.estimate().sigmas
    for _ in range(100):
        particles.predict(0.0, 0.0, CURVED.yaw_at)
        weigh(particles, window_at(5.0, 0.0, rng), 0.0)
    assert particles.estimate().sigmas == pytest.approx(before)


def test_few_particles_that_weigh_are_drawn_anew():
    particles = ParticleFilter(ParticleSettings(count=1000))
    particles.start(0.0, 0.0, (1.0, 0.1))
    similarity = np.where(particles.metres > 1.0, 1.0, 0.0)
    particles.weigh(similarity, 1.0)
    assert particles.effective == pytest.approx(1000.0)
    assert (particles.metres > 1.0).all()


def test_the_same_seed_gives_the_same_particles():
    ends = []
    for _ in range(2):
        rng, particles = np.random.default_rng(6), ParticleFilter(seed=7)
        particles.start(2.0, 0.0, (0.5, 0.1))
        drive(particles, 2.0, 0.0, rng, frames=20)
        ends.append(particles.metres)
    np.testing.assert_array_equal(*ends)


def test_between_two_images_similarity_is_that_of_both_each_at_its_own_shift():
    path = TaughtPath(np.array([0.0, 1.0]), np.array([0.0, 0.1]), np.ones(1))
    curves = np.zeros((2, COUNT))
    curves[0, COUNT // 2 + 10] = 0.8
    curves[1, COUNT // 2] = 0.4
    window = Window(path.metres, path.yaw, curves, STEP, 1.0)
    assert window.similarity(np.array([0.25]), np.array([0.1]))[0] == pytest.approx(0.75 * 0.8 + 0.25 * 0.4)
    far = window.similarity(np.array([-3.0, 0.0]), np.array([0.1, 0.1]))
    assert far[0] < 0.05 * far[1]
    assert window.similarity(np.array([0.5]), np.array([2.0]))[0] == 0.0
