"""The vehicle beside its path as a linear system: the equations that tie the controller's horizon together.

The model is that of a vehicle in the path's own coordinates (e.g. Rajamani, *Vehicle Dynamics and Control*, or
Kanayama et al., 1990), linearised about the reference: for arclength ``s``, lateral error ``e``, heading error
``psi``, speed ``v``, turn rate ``w``,

    ds/dt = v (1 + kappa e),    de/dt = v psi,    dpsi/dt = w - kappa v (1 + kappa e),

and the base follows the commanded ``vc`` and ``wc`` with a first-order lag. The inputs are the commands' rates of
change, so that limits on acceleration are plain bounds. Speeds here are along the direction of travel, hence never
negative: a robot that drives backwards is one that drives forwards with its heading turned by pi.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]

STATES, INPUTS = 7, 2
S, E, PSI, V, W, VC, WC = range(STATES)
A, ALPHA = STATES, STATES + 1
STRIDE = STATES + INPUTS
"""A step of the horizon holds the state at its end, then the inputs during it."""

_CHANGING = [(S, E), (E, PSI), (PSI, V), (PSI, E)]
_COUPLED = [(S, V), (PSI, W), (V, VC), (W, WC), *_CHANGING]
_STATE = np.array([(i, i) for i in range(STATES)] + _COUPLED)
_INPUT = np.array([(VC, A), (WC, ALPHA)])


class Equalities:
    """``A z = b``: the model over the horizon, ``z`` the states and inputs of each step, with a fixed pattern.

    Rows are written as ``after x_{k+1} + before x_k + input u_k = 0`` by the trapezoidal rule, which couples a state to
    those of the same step, and the lag by its exact response to a ramp. Both blocks have the same pattern, and only
    the couplings that depend on the reference are ever written anew.
    """

    def __init__(self, horizon: int, step: float, lag: float) -> None:
        self._n, self._dt = horizon, step
        rows, columns = self._pattern()
        self._order = np.lexsort((rows, columns))
        self._A = sparse.csc_matrix((np.ones(len(rows)), (rows, columns)), shape=(horizon * STATES, horizon * STRIDE))
        self._A.sort_indices()
        after, self._before = _constant_blocks(step, lag)
        self._b = np.zeros(horizon * STATES)
        changing = len(_CHANGING)
        self._after_values = np.tile(after[*_STATE.T], (horizon, 1))
        self._before_values = np.tile(self._before[*_STATE.T], (horizon, 1))
        self._changing = slice(-changing, None)
        self._inputs = np.full(horizon * INPUTS, -step)

    def fill(self, start: Array, v: Array, curvature: Array) -> tuple[sparse.csc_matrix, Array]:
        """The matrix and right-hand side for a start (7,), and speed and curvature (n + 1,) at the ends of the steps.

        Both are overwritten by the next call.
        """
        half = 0.5 * self._dt
        speed, kappa = 0.5 * (v[:-1] + v[1:]), 0.5 * (curvature[:-1] + curvature[1:])
        bend = kappa * speed
        changing = np.stack([-half * bend, -half * speed, half * kappa, half * kappa * bend], axis=1)
        self._after_values[:, self._changing] = self._before_values[:, self._changing] = changing
        values = np.concatenate([self._after_values.ravel(), self._before_values[1:].ravel(), self._inputs])
        self._A.data[:] = values[self._order]
        for (row, column), value in zip(_CHANGING, changing[0], strict=True):
            self._before[row, column] = value
        self._b[:STATES] = -self._before @ start
        return self._A, self._b

    def _pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of every stored number, in the order in which :meth:`fill` lists them."""
        steps = np.arange(self._n)[:, None]
        after = (steps * STATES + _STATE[:, 0], steps * STRIDE + _STATE[:, 1])
        before = (steps[1:] * STATES + _STATE[:, 0], (steps[1:] - 1) * STRIDE + _STATE[:, 1])
        inputs = (steps * STATES + _INPUT[:, 0], steps * STRIDE + _INPUT[:, 1])
        rows = np.concatenate([part[0].ravel() for part in (after, before, inputs)])
        columns = np.concatenate([part[1].ravel() for part in (after, before, inputs)])
        return rows, columns


def _constant_blocks(step: float, lag: float) -> tuple[Array, Array]:
    """``after`` and ``before`` (7, 7) of any step, without what depends on the reference."""
    after, before = np.eye(STATES), -np.eye(STATES)
    for block in (after, before):
        block[S, V] = -0.5 * step
        block[PSI, W] = -0.5 * step
    keep = math.exp(-step / lag) if lag > 0.0 else 0.0
    mean = lag / step * (1.0 - keep)
    for motion, command in ((V, VC), (W, WC)):
        before[motion, motion] = -keep
        before[motion, command] = -(mean - keep)
        after[motion, command] = -(1.0 - mean)
    return after, before
