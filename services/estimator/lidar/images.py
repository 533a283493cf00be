"""Image formation: a scan becomes a stack of azimuth, elevation, range and intensity images.

C. McManus, P. Furgale and T. Barfoot, *Towards lighting-invariant visual navigation: an appearance-based approach using
scanning laser-rangefinders*, RAS 2013: the intensities are multiplied by their ranges and rescaled to [0, 255]. The
stack keeps what was measured at each pixel, so nothing is assumed of how the beams are mounted.

Each beam has a laser and a receiver of its own, whose gain differs from its neighbours'. Left as they are, these
differences are rings that move with the sensor: on the ground, where a ring has the same range wherever the vehicle is,
they are features that agree on a vehicle that stands still. So brightness is rescaled row by row.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.lidar import LidarScan
from services.estimator.lidar import beams
from services.estimator.lidar.beams import ScanError, StackGeometry
from services.estimator.lidar.settings import ImageSettings

Image = NDArray[np.uint8]
Array32 = NDArray[np.float32]

_QUARTILES, _TAILS = 1.349, 3.29
"""Distance of a Gaussian's quartiles, and of its outer twentieths, in standard deviations."""
_FEW = 8
"""A row with fewer measurements has no brightness."""
_GREY = 128.0


@dataclass(frozen=True, slots=True)
class ImageStack:
    """What a scan measured, pixel by pixel; rows from the top, columns along the turn.

    Attributes:
        azimuth, elevation: (H, W) float32, radians.
        range: (H, W) float32, metres; 0 where nothing came back.
        offsets: (H, W) float32, seconds from the stamp.
        intensity: (H, W) float32, corrected for the range by multiplying with it.
        brightness: (rows, W) uint8, the rescaled intensity with its holes filled: for detection alone. Each row of the
            stack takes ``row_scale`` of its rows, so that its pixels are about square.
        mask: (rows, W) bool, where brightness is measured rather than filled in, the surroundings included. The
            outline of what the vehicle hides from its own lidar is a feature that never moves.
        row_scale: as said.
        geometry: of the lidar.
    """

    azimuth: Array32
    elevation: Array32
    range: Array32
    offsets: Array32
    intensity: Array32
    brightness: Image
    mask: NDArray[np.bool_]
    row_scale: int
    geometry: StackGeometry

    def places(self, points: Array32) -> NDArray[np.float64]:
        """Places (N, 2), x and y, in the stack of points (N, 2) in the detection image."""
        return np.stack([points[:, 0], (points[:, 1] + 0.5) / self.row_scale - 0.5], axis=-1).astype(np.float64)


def form(scan: LidarScan, geometry: StackGeometry, settings: ImageSettings) -> ImageStack:
    """The image stack of a checked scan.

    Raises:
        ScanError: the scan does not fit the lidar's geometry.
    """
    rows = _rows(scan, geometry)
    shape = (geometry.rows, geometry.columns)
    azimuth, elevation, range_, offsets, intensity = (np.zeros(shape, dtype=np.float32) for _ in range(5))
    points = np.require(scan.points, np.float32, ["C", "W"]).reshape(-1, 3)
    times = np.zeros(len(points)) if scan.offsets is None else scan.offsets
    _scatter(
        points,
        np.require(scan.intensity, np.float32, ["C", "W"]).ravel(),
        np.require(times, np.float32, ["C", "W"]).ravel(),
        rows,
        geometry.organised,
        scan.reflectivity,
        settings.min_range,
        settings.max_range,
        azimuth, elevation, range_, offsets, intensity,
    )  # fmt: skip
    if not (range_ > 0.0).any():
        raise ScanError("the scan has no point within the lidar's range")
    row_scale = max(1, min(4, round(geometry.row_step / geometry.column_step)))
    brightness = _brightness(range_, intensity, row_scale, settings)
    mask = _supported(range_, row_scale, settings)
    return ImageStack(azimuth, elevation, range_, offsets, intensity, brightness, mask, row_scale, geometry)


def _rows(scan: LidarScan, geometry: StackGeometry) -> NDArray[np.int64]:
    """Row (N,) of each point, -1 for a beam that the geometry does not know."""
    if geometry.organised:
        if scan.points.ndim != 3 or scan.points.shape[:2] != (geometry.rows, geometry.columns):
            raise ScanError(
                f"the scan is {'x'.join(map(str, scan.points.shape[:-1]))}, the lidar's are "
                f"{geometry.rows}x{geometry.columns}"
            )
        return np.repeat(geometry.row_of_ring, geometry.columns)
    if scan.points.ndim != 2:
        raise ScanError("the scan is organised, the lidar's first one was not")
    if scan.rings is not None:
        rings = np.asarray(scan.rings, dtype=np.int64)
        # What the first scan did not see of the lidar is a beam that saw nothing then; many such are another lidar.
        strange = rings >= len(geometry.row_of_ring)
        if strange.mean() > 0.1:
            raise ScanError(f"the scan has rings up to {int(rings.max())}, the lidar's are {len(geometry.row_of_ring)}")
        return np.where(strange, -1, geometry.row_of_ring[np.where(strange, 0, rings)])
    azimuth, elevation = beams.directions(scan.points)
    if not geometry.ordered:
        between = 0.5 * (geometry.elevations[:-1] + geometry.elevations[1:])
        return np.asarray(np.searchsorted(-between, -np.nan_to_num(elevation)))
    found = beams.rings_by_order(azimuth)
    if found is None:
        raise ScanError("the scan's points are not in the order of the lidar's beams")
    return _aligned(found, elevation, geometry)


def _aligned(rings: NDArray[np.int64], elevation: NDArray[np.float64], geometry: StackGeometry) -> NDArray[np.int64]:
    """Rows (N,) of rings told by order, which a beam without a single return shifts against the lidar's."""
    known = np.isfinite(elevation)
    count = np.bincount(rings[known])
    with np.errstate(invalid="ignore"):
        means = np.bincount(rings[known], elevation[known]) / count
    known = np.flatnonzero((count > 5) & (np.arange(len(count)) < len(geometry.row_of_ring)))
    best, least = 0, np.inf
    for shift in (0, 1, -1, 2, -2):
        place = known + shift
        inside = (place >= 0) & (place < len(geometry.row_of_ring))
        rows = geometry.row_of_ring[place[inside]]
        off = np.abs(means[known[inside]] - geometry.elevations[rows])[rows >= 0]
        # A shift must pay: scenes move a beam's mean elevation by a part of the step as well.
        cost = (float(np.median(off)) if len(off) else np.inf) + 0.3 * abs(shift) * geometry.row_step
        if cost < least:
            best, least = shift, cost
    if least > 2.0 * geometry.row_step:
        raise ScanError("the scan's beams do not lie where the lidar's do")
    place = rings + best
    inside = (place >= 0) & (place < len(geometry.row_of_ring))
    return np.where(inside, geometry.row_of_ring[np.where(inside, place, 0)], -1)


@kernel
def _scatter(
    points: Array32,
    intensities: Array32,
    times: Array32,
    rows: NDArray[np.int64],
    organised: bool,  # noqa: FBT001 - compiled functions take no keywords
    reflectivity: bool,  # noqa: FBT001
    min_range: float,
    max_range: float,
    azimuth: Array32,
    elevation: Array32,
    range_: Array32,
    offsets: Array32,
    intensity: Array32,
) -> None:
    """Write each point to its pixel; the nearest wins where several fall into one."""
    width = range_.shape[1]
    for i in range(points.shape[0]):
        row = rows[i]
        if row < 0:
            continue
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        distance = np.sqrt(x * x + y * y + z * z)
        # Written so that what is not a number is left out.
        if not (distance >= min_range and distance <= max_range and np.isfinite(intensities[i])):
            continue
        turned = np.arctan2(y, x)
        around = min(max(int((np.pi - turned) / (2.0 * np.pi) * width), 0), width - 1)
        column = i % width if organised else around
        if range_[row, column] > 0.0 and range_[row, column] <= distance:
            continue
        azimuth[row, column] = turned
        elevation[row, column] = np.arctan2(z, np.sqrt(x * x + y * y))
        range_[row, column] = distance
        offsets[row, column] = times[i]
        intensity[row, column] = intensities[i] * (1.0 if reflectivity else distance)


@kernel
def _statistics(ranges: Array32, intensity: Array32, values: NDArray[np.float64]) -> tuple[float, float]:
    """Median and standard deviation, told by quantiles, of a row (W,) of the stack; ``values`` (W,) is room to sort."""
    count = 0
    for u in range(ranges.shape[0]):
        if ranges[u] > 0.0:
            values[count] = intensity[u]
            count += 1
    if count < _FEW:
        return 0.0, 0.0
    ordered = np.sort(values[:count])
    middle = ordered[count // 2]
    spread = (ordered[(3 * count) // 4] - ordered[count // 4]) / _QUARTILES
    # Where most of a row is alike, what stands out is told by the tails.
    tails = (ordered[(19 * count) // 20] - ordered[count // 20]) / _TAILS
    return float(middle), float(max(spread, 0.5 * tails, 1e-6 * (1.0 + middle)))


@kernel
def _fill_holes(ranges: Array32, row: Array32) -> None:
    """Fill a row (W,) of which something is measured linearly between its neighbours, once round the turn."""
    width = ranges.shape[0]
    start = 0
    while ranges[start] <= 0.0:
        start += 1
    before = start
    for step in range(start + 1, start + width + 1):
        if ranges[step % width] > 0.0:
            for hole in range(before + 1, step):
                part = (hole - before) / (step - before)
                row[hole % width] = (1.0 - part) * row[before % width] + part * row[step % width]
            before = step


@kernel
def _rescale(ranges: Array32, intensity: Array32, contrast: float, out: Array32) -> None:
    """Write the stack's brightness (H, W): each row's median grey, its standard deviation ``contrast``."""
    values = np.zeros(ranges.shape[1])
    for v in range(ranges.shape[0]):
        middle, deviation = _statistics(ranges[v], intensity[v], values)
        if deviation <= 0.0:
            out[v] = _GREY
            continue
        for u in range(ranges.shape[1]):
            out[v, u] = _GREY + contrast * (intensity[v, u] - middle) / deviation
        _fill_holes(ranges[v], out[v])


def _brightness(range_: Array32, intensity: Array32, row_scale: int, settings: ImageSettings) -> Image:
    """Rescaled intensity with filled holes, (H * row_scale, W)."""
    bright = np.zeros(range_.shape, dtype=np.float32)
    _rescale(range_, intensity, settings.contrast, bright)
    image: Image = np.clip(bright, 0.0, 255.0).astype(np.uint8)
    if row_scale == 1:
        return image
    size = (image.shape[1], image.shape[0] * row_scale)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _supported(range_: Array32, row_scale: int, settings: ImageSettings) -> NDArray[np.bool_]:
    """Where the stack's surroundings are filled with measurements, (H * row_scale, W)."""
    half = settings.support
    measured = cv2.copyMakeBorder((range_ > 0.0).astype(np.float32), 0, 0, half, half, cv2.BORDER_WRAP)
    window = (2 * half + 1, 2 * (half // row_scale) + 1)
    filled = cv2.blur(measured, window, borderType=cv2.BORDER_REPLICATE)[:, half:-half]
    return np.repeat(filled >= settings.min_support, row_scale, axis=0)
