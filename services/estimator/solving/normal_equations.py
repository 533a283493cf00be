"""Normal equations of a few unknowns: summed up from 3-dimensional measurements, and solved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel

Array = NDArray[np.float64]


@kernel
def accumulate(
    jacobian: Array, information: Array, error: Array, weight: float, hessian: Array, gradient: Array
) -> None:
    """Add ``w J^T W J``, of which only the upper half, and ``w J^T W e`` of one measurement; J is (3, n)."""
    n = jacobian.shape[1]
    for a in range(n):
        x = y = z = 0.0
        for i in range(3):
            x += jacobian[i, a] * information[i, 0]
            y += jacobian[i, a] * information[i, 1]
            z += jacobian[i, a] * information[i, 2]
        gradient[a] += weight * (x * error[0] + y * error[1] + z * error[2])
        for b in range(a, n):
            hessian[a, b] += weight * (x * jacobian[0, b] + y * jacobian[1, b] + z * jacobian[2, b])


@kernel
def cholesky_solve(hessian: Array, gradient: Array, step: Array) -> bool:
    """Solve with the upper half of a positive definite matrix, which is overwritten; False where it is not definite."""
    n = gradient.shape[0]
    for i in range(n):
        for j in range(i, n):
            total = hessian[i, j]
            for p in range(i):
                total -= hessian[p, i] * hessian[p, j]
            if i == j:
                if not total > 0.0:
                    return False
                hessian[i, i] = np.sqrt(total)
            else:
                hessian[i, j] = total / hessian[i, i]
    for i in range(n):
        total = gradient[i]
        for p in range(i):
            total -= hessian[p, i] * step[p]
        step[i] = total / hessian[i, i]
    for i in range(n - 1, -1, -1):
        total = step[i]
        for p in range(i + 1, n):
            total -= hessian[i, p] * step[p]
        step[i] = total / hessian[i, i]
    return True
