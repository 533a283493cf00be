"""Which beam of a spinning lidar measured each point, and how its beams and columns lie.

An organised scan tells; so do ring numbers. Where a recording has neither (KITTI's ``.bin``), the order of the points
tells, for its files hold one beam's turn after the other. Where that fails as well, the points' elevations are cut
into rows of equal height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.lidar import LidarScan

Array = NDArray[np.float64]

MAX_BEAMS = 512
_MIN_BEAMS = 4
_MIN_TURN = 50
"""Points that a beam's turn holds at least, on average, for the order of the points to be believed."""
_STEP = 0.03
"""Longest step between two neighbours of a turn, radians: what is longer is a gap."""
_BINNED_ROWS = 64
_WIDER = 1.15
"""A pixel's width in steps of the lidar: a little more than one, so that none stays empty between two steps."""
_COLUMNS = (180, 4096)


class ScanError(ValueError):
    """A scan is not what a spinning lidar with intensity delivers."""


@dataclass(frozen=True, slots=True)
class StackGeometry:
    """The image stack that a lidar's scans fill, the same for all of them.

    Attributes:
        elevations: (H,) radians, the beams' median elevations, from the top row down.
        columns: how many there are to a turn.
        row_of_ring: (R,) row of each ring number.
        organised: whether scans come as an array of these rows and columns.
        ordered: whether a scan's rings are told by the order of its points.
    """

    elevations: Array
    columns: int
    row_of_ring: NDArray[np.int64]
    organised: bool
    ordered: bool

    @property
    def rows(self) -> int:
        """How many rows the stack has."""
        return len(self.elevations)

    @property
    def column_step(self) -> float:
        """Radians from column to column."""
        return 2.0 * np.pi / self.columns

    @property
    def row_step(self) -> float:
        """Radians from row to row, their median."""
        return float(np.median(np.abs(np.diff(self.elevations))))

    def pixels_of(self, places: Array) -> NDArray[np.float32]:
        """Columns and rows (N, 2) of a scan at places (N, 2) of the stack, whose rows are from the top down."""
        pixels = places.astype(np.float32)
        if self.organised:
            ring_of_row = np.argsort(self.row_of_ring)
            pixels[:, 1] = ring_of_row[np.clip(np.rint(pixels[:, 1]).astype(np.int64), 0, self.rows - 1)]
        return pixels


def directions(points: NDArray[np.float32]) -> tuple[Array, Array]:
    """Azimuth and elevation (N,), radians, of points (N, 3); nan where nothing came back."""
    azimuth, elevation = np.full(len(points), np.nan), np.full(len(points), np.nan)
    _directions(np.require(points, np.float32, ["C", "W"]), azimuth, elevation)
    return azimuth, elevation


@kernel
def _directions(points: NDArray[np.float32], azimuth: Array, elevation: Array) -> None:
    for i in range(points.shape[0]):
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        square = x * x + y * y
        if 0.0 < square + z * z < np.inf:
            azimuth[i], elevation[i] = np.arctan2(y, x), np.arctan2(z, np.sqrt(square))


def estimate_geometry(scan: LidarScan) -> StackGeometry:
    """The stack that fits a scan, which :func:`services.estimator.lidar.scan.check` has found to be sound.

    Raises:
        ScanError: its points do not tell how the lidar's beams lie.
    """
    points = scan.points.reshape(-1, 3)
    azimuth, elevation = directions(points)
    if scan.points.ndim == 3:
        height, width = scan.points.shape[:2]
        rings, ordered = np.repeat(np.arange(height), width), False
    elif scan.rings is not None:
        rings, ordered = np.asarray(scan.rings, dtype=np.int64), False
    else:
        found = rings_by_order(azimuth)
        ordered = found is not None
        rings = rows_by_elevation(elevation) if found is None else found
    order, elevations = _from_the_top(rings, elevation)
    row_of_ring = np.full(int(rings.max()) + 1, -1, dtype=np.int64)
    row_of_ring[order] = np.arange(len(order))
    organised = scan.points.ndim == 3
    if organised:
        # A beam without a single return must not move the others' rows.
        if len(order) < scan.points.shape[0]:
            row_of_ring, elevations = _rows_as_given(scan, order, elevations)
        return StackGeometry(elevations, scan.points.shape[1], row_of_ring, organised=True, ordered=False)
    if len(order) < _MIN_BEAMS:
        raise ScanError(f"the scan has points of {len(order)} beams only: at least {_MIN_BEAMS} are needed")
    return StackGeometry(elevations, _columns(azimuth, rings), row_of_ring, organised=False, ordered=ordered)


def rings_by_order(azimuth: Array) -> NDArray[np.int64] | None:
    """Rings (N,) of points that come one beam's turn after the other; None where they do not.

    A turn ends where the azimuth jumps back by more than half a circle; noise at the seam jumps to and fro.
    """
    rings = np.zeros(len(azimuth), dtype=np.int64)
    known, count, forward = _turns(azimuth, rings)
    if known < _MIN_BEAMS * _MIN_TURN or not _MIN_BEAMS <= count <= MAX_BEAMS:
        return None
    return rings if known >= count * _MIN_TURN and forward > 0.9 * known else None


@kernel
def _turns(azimuth: Array, rings: NDArray[np.int64]) -> tuple[int, int, int]:
    """Write the number of turns before each point; how many points there are, how many turns, and steps forwards.

    Turns are cut half a step before the azimuth of the first point, wherever that is.
    """
    forwards, backwards, last = 0, 0, np.nan
    steps, total = 1, 0.0
    for i in range(azimuth.shape[0]):
        step = azimuth[i] - last
        forwards += 0.0 < step < np.pi
        backwards += -np.pi < step < 0.0
        if abs(step) < _STEP:
            steps += 1
            total += abs(step)
        if np.isfinite(azimuth[i]):
            last = azimuth[i]
    direction = 1.0 if forwards >= backwards else -1.0
    half = 0.5 * total / steps
    known, turns, least, most, ahead, first, before = 0, 0, 0, 0, 0, 0.0, 0.0
    for i in range(azimuth.shape[0]):
        if not np.isfinite(azimuth[i]):
            continue
        if known == 0:
            first = azimuth[i]
        turned = (direction * (azimuth[i] - first) + half) % (2.0 * np.pi)
        if known > 0:
            step = turned - before
            turns += int(step < -np.pi) - int(step > np.pi)
            ahead += step > 0.0 or abs(step) > np.pi
        least, most, before = min(least, turns), max(most, turns), turned
        rings[i] = turns
        known += 1
    rings -= least
    return known, most - least + 1, ahead


def rows_by_elevation(elevation: Array, rows: int = _BINNED_ROWS) -> NDArray[np.int64]:
    """Rings (N,) of equal height over the elevations (N,) that are found."""
    low, high = np.nanpercentile(elevation, [0.2, 99.8])
    part = (elevation - low) / max(float(high - low), 1e-6)
    binned: NDArray[np.int64] = np.clip(np.nan_to_num(part) * rows, 0, rows - 1).astype(np.int64)
    return binned


def _from_the_top(rings: NDArray[np.int64], elevation: Array) -> tuple[NDArray[np.int64], Array]:
    """The rings that measured something, from the highest down, and their median elevations."""
    known = np.flatnonzero(np.isfinite(elevation))
    sorted_ = known[np.argsort(rings[known], kind="stable")]
    present, starts = np.unique(rings[sorted_], return_index=True)
    groups = np.split(elevation[sorted_], starts[1:])
    enough = np.array([len(g) >= min(_MIN_TURN, len(known) // (2 * len(groups)) + 1) for g in groups])
    medians = np.array([np.median(g) for g in groups])
    order = np.argsort(-medians[enough], kind="stable")
    return present[enough][order], medians[enough][order]


def _rows_as_given(scan: LidarScan, order: NDArray[np.int64], elevations: Array) -> tuple[NDArray[np.int64], Array]:
    """Rows of an organised scan some of whose beams saw nothing: in the array's own order."""
    height = scan.points.shape[0]
    downwards = len(order) < 2 or order[0] < order[-1]
    row_of_ring = np.arange(height) if downwards else np.arange(height)[::-1].copy()
    rows = row_of_ring[order]
    ranked = np.argsort(rows)
    return row_of_ring, np.interp(np.arange(height), rows[ranked], elevations[ranked])


def _columns(azimuth: Array, rings: NDArray[np.int64]) -> int:
    """Columns of pixels slightly wider than the lidar's own step, by its busiest ring."""
    known = np.isfinite(azimuth)
    busiest = int(np.argmax(np.bincount(rings[known])))
    turn = np.sort(azimuth[known & (rings == busiest)])
    step = float(np.median(np.diff(turn)))
    return int(np.clip(2.0 * np.pi / max(_WIDER * step, 1e-4), *_COLUMNS))
