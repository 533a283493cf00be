"""Model-predictive path following: one sparse quadratic programme a cycle, always of the same shape.

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
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import piqp
from numpy.typing import NDArray
from scipy import sparse

if TYPE_CHECKING:
    from services.tracker.limits import Limits

Array = NDArray[np.float64]

_STATES, _INPUTS = 7, 2
_S, _E, _PSI, _V, _W, _VC, _WC = range(_STATES)
_A, _ALPHA = _STATES, _STATES + 1
_STRIDE = _STATES + _INPUTS
_ROUNDING = 1e-6
"""A solution may exceed its bounds by the solver's tolerance; by more than this it is not used."""


@dataclass(frozen=True, slots=True)
class Weights:
    """What a squared error costs over the horizon. ``last`` multiplies the errors' weights in the last step."""

    progress: float = 4.0
    lateral: float = 30.0
    heading: float = 8.0
    speed: float = 2.0
    turn_rate: float = 0.5
    acceleration: float = 0.3
    turn_acceleration: float = 0.15
    last: float = 5.0


@dataclass(frozen=True, slots=True)
class MpcSettings:
    """``horizon`` steps of ``step`` seconds; the base's ``lag`` (s); lateral errors count as ``far`` (m) at most."""

    horizon: int = 20
    step: float = 0.1
    lag: float = 0.15
    far: float = 1.0
    weights: Weights = field(default_factory=Weights)


@dataclass(frozen=True, slots=True)
class State:
    """The vehicle beside the path: errors, measured speeds along the direction of travel, and the last command."""

    s: float
    lateral: float
    heading: float
    v: float
    w: float
    v_command: float
    w_command: float


@dataclass(frozen=True, slots=True)
class Reference:
    """What to follow, at the ends of the steps: arclength, speed, curvature, each (horizon + 1,), the first one now."""

    s: Array
    v: Array
    curvature: Array


@dataclass(frozen=True, slots=True)
class Command:
    """Speed along the direction of travel and turn rate; ``problem`` says why it is a stop, or is empty."""

    v: float
    w: float
    problem: str = ""


def brake(v: float, w: float, seconds: float, limits: Limits) -> tuple[float, float]:
    """A command one cycle nearer to rest, on the same arc: ``v / w`` stays, and no limit on acceleration is exceeded.

    ``v`` of either sign. Turning on the spot is slowed by the limit on the turn's acceleration.
    """
    keep_v = 1.0 - limits.deceleration * seconds / max(abs(v), 1e-9)
    keep_w = 1.0 - limits.turn_acceleration * seconds / max(abs(w), 1e-9)
    keep = max(keep_v, keep_w, 0.0)
    return v * keep, w * keep


class PathMpc:
    """The controller. Set up once; :meth:`solve` only updates numbers.

    ``limits.lateral_acceleration`` is the business of the reference's speed; all other limits hold in every command.
    """

    def __init__(self, limits: Limits, settings: MpcSettings | None = None) -> None:
        self._limits = limits
        self._settings = settings or MpcSettings()
        self._model = _Equalities(self._settings)
        self._cost = _diagonal_cost(self._settings)
        self._solver = self._set_up()

    @property
    def settings(self) -> MpcSettings:
        """The settings that it was made with."""
        return self._settings

    def solve(self, state: State, reference: Reference, seconds: float) -> Command:
        """The command for the next ``seconds``, at most one step of the horizon.

        A last command beyond the limits (they may have been tightened meanwhile) is first brought within them. Where
        no solution is found, the command is one step of :func:`brake`, with the reason.
        """
        v0, w0 = self._within_limits(state.v_command, state.w_command)
        start = np.array([state.s, state.lateral, state.heading, state.v, state.w, v0, w0])
        if not (np.isfinite(start).all() and np.isfinite([reference.s, reference.v, reference.curvature]).all()):
            return Command(*brake(v0, w0, seconds, self._limits), "the state or the reference is not finite")
        start[_E] = min(max(state.lateral, -self._settings.far), self._settings.far)
        # Arclength is counted from the robot: hundreds of metres in the numbers cost the solver its precision.
        start[_S] = 0.0
        A, b = self._model.fill(start, reference)
        self._solver.update(c=self._linear_cost(reference, state.s), A=A, b=b)
        status = self._solver.solve()
        if status != piqp.PIQP_SOLVED:
            return Command(*brake(v0, w0, seconds, self._limits), f"the controller found no solution ({status.name})")
        return self._first_command(v0, w0, seconds)

    def _first_command(self, v0: float, w0: float, seconds: float) -> Command:
        """The command after ``seconds`` of the solution's first rates.

        The bounds are convex, so what holds at both ends of the first step holds between them.
        """
        limits = self._limits
        share = min(seconds, self._settings.step)
        a, alpha = (float(value) for value in self._solver.result.x[_A : _ALPHA + 1])
        a = min(max(a, -limits.deceleration), limits.acceleration)
        alpha = min(max(alpha, -limits.turn_acceleration), limits.turn_acceleration)
        v, w = v0 + a * share, w0 + alpha * share
        v_in, w_in = self._within_limits(v, w)
        if abs(v - v_in) > 1e3 * _ROUNDING or abs(w - w_in) > 1e3 * _ROUNDING:
            return Command(*brake(v0, w0, seconds, limits), "the controller's solution exceeds its limits")
        return Command(v_in, w_in)

    def _within_limits(self, v: float, w: float) -> tuple[float, float]:
        limits = self._limits
        if not (math.isfinite(v) and math.isfinite(w)):
            return 0.0, 0.0
        v = min(max(v, 0.0), limits.speed)
        bound = limits.turn_rate if limits.curvature is None else min(limits.turn_rate, limits.curvature * v)
        return v, min(max(w, -bound), bound)

    def _linear_cost(self, reference: Reference, origin: float) -> Array:
        """``c`` of ``1/2 x'Px + c'x`` for quadratic costs about the reference."""
        wanted = np.zeros((self._settings.horizon, _STRIDE))
        wanted[:, _S] = reference.s[1:] - origin
        wanted[:, _V] = wanted[:, _VC] = reference.v[1:]
        wanted[:, _W] = wanted[:, _WC] = reference.v[1:] * reference.curvature[1:]
        return -self._cost * wanted.ravel()

    def _set_up(self) -> piqp.SparseSolver:
        n, limits = self._settings.horizon, self._limits
        low = np.full((n, _STRIDE), -np.inf)
        low[:, _VC], low[:, _WC] = 0.0, -limits.turn_rate
        low[:, _A], low[:, _ALPHA] = -limits.deceleration, -limits.turn_acceleration
        high = np.full((n, _STRIDE), np.inf)
        high[:, _VC], high[:, _WC] = limits.speed, limits.turn_rate
        high[:, _A], high[:, _ALPHA] = limits.acceleration, limits.turn_acceleration
        solver = piqp.SparseSolver()
        # Checked rather than trusted: commands in m/s and rad/s need no eighth digit, and each iteration costs.
        solver.settings.eps_abs = solver.settings.eps_rel = _ROUNDING
        solver.settings.preconditioner_reuse_on_update = True
        rest = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        still = np.zeros(n + 1)
        A, b = self._model.fill(
            np.array([getattr(rest, name) for name in State.__slots__]), Reference(still, still, still)
        )
        P = sparse.csc_matrix(sparse.diags(self._cost))
        c = np.zeros(n * _STRIDE)
        G, h = _curvature_rows(n, limits.curvature)
        solver.setup(P, c, A, b, G, None, h, low.ravel(), high.ravel())
        return solver


def _diagonal_cost(settings: MpcSettings) -> Array:
    """Diagonal of ``P`` (horizon * stride,): the speeds' weights are shared by the motion and by its command."""
    weights, step = settings.weights, np.zeros(_STRIDE)
    step[_S], step[_E], step[_PSI] = weights.progress, weights.lateral, weights.heading
    step[_V] = step[_VC] = 0.5 * weights.speed
    step[_W] = step[_WC] = 0.5 * weights.turn_rate
    step[_A], step[_ALPHA] = weights.acceleration, weights.turn_acceleration
    cost = np.tile(step, (settings.horizon, 1))
    cost[-1, : _PSI + 1] *= weights.last
    return cost.ravel()


def _curvature_rows(horizon: int, curvature: float | None) -> tuple[sparse.csc_matrix | None, Array | None]:
    """``+-wc - curvature * vc <= 0`` at every step; nothing without a bound."""
    if curvature is None:
        return None, None
    block = np.zeros((2, _STRIDE))
    block[:, _VC], block[:, _WC] = -curvature, (1.0, -1.0)
    return sparse.csc_matrix(sparse.kron(sparse.eye(horizon), block)), np.zeros(2 * horizon)


class _Equalities:
    """``A z = b``: the model over the horizon, ``z`` the states and inputs of each step, with a fixed pattern.

    Rows are written as ``after x_{k+1} + before x_k + input u_k = 0`` by the trapezoidal rule, which couples a state to
    those of the same step, and the lag by its exact response to a ramp.
    """

    def __init__(self, settings: MpcSettings) -> None:
        self._n, self._dt = settings.horizon, settings.step
        self._lag = settings.lag
        rows, columns = self._pattern()
        order = np.lexsort((rows, columns))
        size = (self._n * _STATES, self._n * _STRIDE)
        self._order = order
        self._A = sparse.csc_matrix((np.ones(len(order)), (rows, columns)), shape=size)
        self._A.sort_indices()

    def fill(self, start: Array, reference: Reference) -> tuple[sparse.csc_matrix, Array]:
        """The matrix and right-hand side for a start (7,) and a reference."""
        after, before, inputs = self._blocks(reference)
        values = np.concatenate(
            [after[:, *_AFTER].ravel(), before[1:][:, *_BEFORE].ravel(), inputs[:, *_INPUT].ravel()]
        )
        self._A.data[:] = values[self._order]
        b = np.zeros(self._n * _STATES)
        b[:_STATES] = -before[0] @ start
        return self._A, b

    def _blocks(self, reference: Reference) -> tuple[Array, Array, Array]:
        """Blocks (n, 7, 7), (n, 7, 7) and (n, 7, 2) of every step."""
        n, dt = self._n, self._dt
        v = 0.5 * (reference.v[:-1] + reference.v[1:])
        kappa = 0.5 * (reference.curvature[:-1] + reference.curvature[1:])
        after, before = np.zeros((n, _STATES, _STATES)), np.zeros((n, _STATES, _STATES))
        index = np.arange(_STATES)
        after[:, index, index] = 1.0
        before[:, index, index] = -1.0
        for block in (after, before):
            block[:, _S, _V] = -0.5 * dt
            block[:, _S, _E] = -0.5 * dt * kappa * v
            block[:, _E, _PSI] = -0.5 * dt * v
            block[:, _PSI, _W] = -0.5 * dt
            block[:, _PSI, _V] = 0.5 * dt * kappa
            block[:, _PSI, _E] = 0.5 * dt * kappa * kappa * v
        keep = math.exp(-dt / self._lag) if self._lag > 0.0 else 0.0
        mean = self._lag / dt * (1.0 - keep)
        for motion, command in ((_V, _VC), (_W, _WC)):
            before[:, motion, motion] = -keep
            before[:, motion, command] = -(mean - keep)
            after[:, motion, command] = -(1.0 - mean)
        inputs = np.zeros((n, _STATES, _INPUTS))
        inputs[:, _VC, 0] = inputs[:, _WC, 1] = -dt
        return after, before, inputs

    def _pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of every stored number, in the order in which :meth:`fill` lists them."""
        steps = np.arange(self._n)[:, None]
        after = (steps * _STATES + _AFTER[0], steps * _STRIDE + _AFTER[1])
        later = steps[1:]
        before = (later * _STATES + _BEFORE[0], (later - 1) * _STRIDE + _BEFORE[1])
        inputs = (steps * _STATES + _INPUT[0], steps * _STRIDE + _STATES + _INPUT[1])
        rows = np.concatenate([part[0].ravel() for part in (after, before, inputs)])
        columns = np.concatenate([part[1].ravel() for part in (after, before, inputs)])
        return rows, columns


_COUPLED = [(_S, _V), (_S, _E), (_E, _PSI), (_PSI, _W), (_PSI, _V), (_PSI, _E), (_V, _VC), (_W, _WC)]
_AFTER = tuple(np.array([(i, i) for i in range(_STATES)] + _COUPLED).T)
_BEFORE = _AFTER
_INPUT = tuple(np.array([(_VC, 0), (_WC, 1)]).T)
