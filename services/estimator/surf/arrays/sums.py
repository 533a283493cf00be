"""The integral image and looks into it, for many places at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf.arrays.device import Array, Device


class Sums(NamedTuple):
    """As :class:`services.estimator.surf.integral.Integral`, at a device.

    Attributes:
        device: where the sums are.
        sums: (H + 2 pad_y + 1, W + 2 pad_x + 1) int32.
        flat: the same, in one row.
        pad_x, pad_y: the margin on either side, pixels.
    """

    device: Device
    sums: Array
    flat: Array
    pad_x: int
    pad_y: int

    def at(self, rows: Array, columns: Array) -> Array:
        """The entries at rows and columns (...) int64, as int64."""
        return self.device.xp.astype(take(self.device, self.flat, rows * self.sums.shape[1] + columns), rows.dtype)


def take(device: Device, flat: Array, index: Array) -> Array:
    """The entries of a row at an index of any shape."""
    xp = device.xp
    return xp.reshape(xp.take(flat, xp.reshape(index, (-1,)), axis=0), index.shape)


def integral(device: Device, wide: NDArray[np.uint8], pad_x: int, pad_y: int) -> Sums:
    """The integral image of an image with its margins."""
    xp = device.xp
    image = xp.astype(device.upload(wide), xp.int32)
    for axis in (0, 1):
        image = xp.cumulative_sum(image, axis=axis, dtype=xp.int32, include_initial=True)
    return Sums(device, image, xp.reshape(image, (-1,)), pad_x, pad_y)


def cells(device: Device, at: Array, size: int) -> tuple[Array, Array]:
    """The entries before coordinates, and the coordinates' distances to them, as ``integral.cell`` gives one."""
    xp = device.xp
    first = xp.clip(xp.floor(at), 0.0, float(size - 2))
    return xp.astype(first, xp.int64), at - first


def interpolated(sums: Sums, u: Array, v: Array) -> Array:
    """The integral image at columns u and rows v between its entries, float64, broadcast against each other."""
    xp = sums.device.xp
    columns, f_u = cells(sums.device, u, sums.sums.shape[1])
    rows, f_v = cells(sums.device, v, sums.sums.shape[0])
    rows, columns = xp.broadcast_arrays(rows, columns)

    def along(row: Array) -> Array:
        here, after = sums.at(row, columns), sums.at(row, columns + 1)
        return xp.astype(here, xp.float64) + f_u * xp.astype(after - here, xp.float64)

    first = along(rows)
    return first + f_v * (along(rows + 1) - first)
