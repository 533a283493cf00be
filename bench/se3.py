"""SE(3) operations a second: ``common.geometry`` beside ``scipy.spatial.transform``, single and in stacks."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import RigidTransform

from bench import table
from common import geometry as se3

_STACK = 1000
_SECONDS = 0.1
_ROUNDS = 3


def main() -> None:
    """Prints transforms a second for each operation."""
    rows: list[list[object]] = []
    xi = np.random.default_rng(0).normal(size=(_STACK, 6))
    for size in (1, _STACK):
        twists = xi[0] if size == 1 else xi
        for name, ours, theirs in _operations(twists):
            own, peer = size * _rate(ours), size * _rate(theirs)
            rows.append([name, size, own, peer, own / peer])
    table.show(
        "SE(3): transforms a second",
        ["operation", "stack", "common.geometry", "scipy RigidTransform", "ratio"],
        rows,
        "compose is a product of 4x4 arrays; adjoint has no counterpart in scipy, so it is built from its parts",
    )


def _operations(xi: np.ndarray) -> list[tuple[str, Callable[[], object], Callable[[], object]]]:
    T = se3.exp(xi)
    coordinates = np.concatenate([xi[..., 3:], xi[..., :3]], axis=-1)
    peer = RigidTransform.from_matrix(T)
    points = np.random.default_rng(1).normal(size=(*xi.shape[:-1], 1, 3))
    flat = points[..., 0, :]
    return [
        ("exp", lambda: se3.exp(xi), lambda: RigidTransform.from_exp_coords(coordinates)),
        ("log", lambda: se3.log(T), peer.as_exp_coords),
        ("compose", lambda: T @ T, lambda: peer * peer),
        ("inverse", lambda: se3.inverse(T), peer.inv),
        ("apply to a point", lambda: se3.apply(T, points), lambda: peer.apply(flat)),
        ("adjoint", lambda: se3.adjoint(T), lambda: _adjoint(peer)),
    ]


def _adjoint(transform: RigidTransform) -> np.ndarray:
    rotation, t = transform.rotation.as_matrix(), transform.translation
    out = np.zeros((*t.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = rotation
    out[..., :3, 3:] = np.cross(t[..., None, :], np.swapaxes(rotation, -1, -2)).swapaxes(-1, -2)
    return out


def _rate(function: Callable[[], object]) -> float:
    """Calls a second, the best of a few rounds."""
    function()
    best = 0.0
    for _ in range(_ROUNDS):
        count, start = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - start) < _SECONDS / _ROUNDS:
            function()
            count += 1
        best = max(best, count / elapsed)
    return best


if __name__ == "__main__":
    main()
