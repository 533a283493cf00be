"""Metric keypoints: azimuth, elevation and range interpolated in the image stack, with covariance.

A keypoint's surface is taken as a plane over a few pixels, which inverse range is linear over. The plane's slope says
how an error of the keypoint's place enters its range: across the surface a lidar measures to centimetres, along it only
the appearance tells. Where no plane fits, at an edge or a hole, there is no keypoint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.lidar.images import Array32, ImageStack
from services.estimator.lidar.settings import KeypointSettings, NoiseSettings

Array = NDArray[np.float64]


@kernel
def _solve3(m: Array, rhs: Array, out: Array) -> bool:
    """Solve a symmetric 3x3 system for three right-hand sides (3, 3), columns; False where it is nearly singular."""
    a, b, c, d, e, f = m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * c00 + b * c01 + c * c02
    if not det > 1e-6 * a * d * f:
        return False
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    for k in range(3):
        x, y, z = rhs[0, k], rhs[1, k], rhs[2, k]
        out[0, k] = (c00 * x + c01 * y + c02 * z) / det
        out[1, k] = (c01 * x + c11 * y + c12 * z) / det
        out[2, k] = (c02 * x + c12 * y + c22 * z) / det
    return True


@kernel
def _turn(azimuth: float, reference: float) -> float:
    """An azimuth's difference from another one, the short way round."""
    return (azimuth - reference + np.pi) % (2.0 * np.pi) - np.pi


@kernel
def _sum_up(azimuth: Array32, elevation: Array32, range_: Array32, u: float, v: float, half_width: int,
    half_height: int, matrix: Array, rhs: Array,
) -> tuple[float, int]:  # fmt: skip
    """Sum up the normal equations of the fit around a place; the azimuth that others are taken from, and the count."""
    height, width = range_.shape
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    matrix[:] = 0.0
    rhs[:] = 0.0
    count, middle = 0, 0.0
    design, values = np.ones(3), np.zeros(3)
    for i in range(max(row - half_height, 0), min(row + half_height + 1, height)):
        for k in range(column - half_width, column + half_width + 1):
            j = k % width
            if range_[i, j] <= 0.0:
                continue
            if count == 0:
                middle = float(azimuth[i, j])
            count += 1
            design[1], design[2] = k - u, i - v
            values[0], values[1] = _turn(azimuth[i, j], middle), elevation[i, j]
            values[2] = 1.0 / range_[i, j]
            for a in range(3):
                for b in range(3):
                    matrix[a, b] += design[a] * design[b]
                    rhs[a, b] += design[a] * values[b]
    return middle, count


@kernel
def _roughness(range_: Array32, u: float, v: float, half_width: int, half_height: int, fit: Array) -> float:
    """Root mean square distance of the window's ranges from the fitted plane, metres."""
    height, width = range_.shape
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    squares, count = 0.0, 0
    for i in range(max(row - half_height, 0), min(row + half_height + 1, height)):
        for k in range(column - half_width, column + half_width + 1):
            distance = range_[i, k % width]
            if distance > 0.0:
                inverse = fit[0, 2] + fit[1, 2] * (k - u) + fit[2, 2] * (i - v)
                # In metres at the measured range: an inverse range's error grows with its square.
                error = (1.0 / distance - inverse) * distance * distance
                squares += error * error
                count += 1
    return float(np.sqrt(squares / max(count, 1)))


@kernel
def _fit(azimuth: Array32, elevation: Array32, range_: Array32, u: float, v: float, half_width: int,
    half_height: int, matrix: Array, rhs: Array, fit: Array,
) -> tuple[float, float, int]:  # fmt: skip
    """Fit azimuth (about that of the middle), elevation and inverse range linearly around a place (u, v) of the stack.

    ``fit`` (3, 3) gets a column for each: value at the place, slope along u, slope along v. Returns the azimuth of the
    middle, the root mean square distance of the ranges from the plane (metres, -1 where nothing fits), and how many
    pixels took part.
    """
    middle, count = _sum_up(azimuth, elevation, range_, u, v, half_width, half_height, matrix, rhs)
    if count < 4 or not _solve3(matrix, rhs, fit) or not fit[0, 2] > 1e-4:
        return middle, -1.0, count
    return middle, _roughness(range_, u, v, half_width, half_height, fit), count


@kernel
def _measure_all(
    places: Array, sigmas: Array, azimuth: Array32, elevation: Array32, range_: Array32, offsets: Array32,
    half_width: int, half_height: int, min_count: float, max_roughness: float, max_relative: float, range_noise: float,
    measurements: Array, covariances: Array, times: Array, good: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write measurement, covariance and offset of keypoints at places (N, 2) of the stack; ``good`` where there is one.

    ``sigmas`` (N, 2) are the places' standard deviations along u and v, pixels of the stack.
    """
    height, width = range_.shape
    matrix, rhs, fit = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    for n in range(places.shape[0]):
        u, v = places[n, 0], places[n, 1]
        middle, roughness, count = _fit(azimuth, elevation, range_, u, v, half_width, half_height, matrix, rhs, fit)
        if roughness < 0.0 or count < min_count:
            continue
        distance = 1.0 / fit[0, 2]
        if roughness > max(max_roughness, max_relative * distance):
            continue
        column, row = int(np.floor(u + 0.5)) % width, min(max(int(np.floor(v + 0.5)), 0), height - 1)
        turn = middle + fit[0, 0]
        measurements[n, 0] = (turn + np.pi) % (2.0 * np.pi) - np.pi
        measurements[n, 1], measurements[n, 2] = fit[0, 1], distance
        times[n] = offsets[row, column]
        # Place errors along u and v enter all three; the range has its own besides.
        for a in range(3):
            for b in range(3):
                covariances[n, a, b] = 0.0
        for k in range(1, 3):
            s2 = sigmas[n, k - 1] ** 2
            by0, by1, by2 = fit[k, 0], fit[k, 1], -distance * distance * fit[k, 2]
            covariances[n, 0, 0] += s2 * by0 * by0
            covariances[n, 0, 1] += s2 * by0 * by1
            covariances[n, 0, 2] += s2 * by0 * by2
            covariances[n, 1, 1] += s2 * by1 * by1
            covariances[n, 1, 2] += s2 * by1 * by2
            covariances[n, 2, 2] += s2 * by2 * by2
        covariances[n, 2, 2] += range_noise * range_noise + roughness * roughness
        covariances[n, 0, 0] += 1e-9
        covariances[n, 1, 1] += 1e-9
        covariances[n, 1, 0], covariances[n, 2, 0] = covariances[n, 0, 1], covariances[n, 0, 2]
        covariances[n, 2, 1] = covariances[n, 1, 2]
        good[n] = True


def measure(
    points: NDArray[np.float32], scales: NDArray[np.float32], stack: ImageStack, settings: KeypointSettings,
    noise: NoiseSettings,
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:  # fmt: skip
    """Measurements (N, 3), covariances (N, 3, 3) and offsets (N,) of keypoints, and which (N,) have one.

    ``points`` (N, 2) are places (x, y) in the detection image, ``scales`` (N,) the keypoints' scales in it.
    """
    count = len(points)
    measurements, covariances, times = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    good = np.zeros(count, dtype=np.bool_)
    places = stack.places(points)
    sigma = noise.pixel * np.maximum(scales.astype(np.float64) / 2.0, 0.5)
    sigmas = np.stack([sigma, sigma / stack.row_scale], axis=-1)
    window = (2 * settings.half_width + 1) * (2 * settings.half_height + 1)
    _measure_all(
        places, sigmas, stack.azimuth, stack.elevation, stack.range, stack.offsets, settings.half_width,
        settings.half_height, settings.min_filled * window, settings.max_roughness, settings.max_relative_roughness,
        noise.range, measurements, covariances, times, good,
    )  # fmt: skip
    return measurements, covariances, times, good
