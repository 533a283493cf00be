"""Model-predictive path following: one sparse quadratic programme a cycle, always of the same shape.

What the vehicle does is in :mod:`services.tracker.model`; here is what it should do, and what it may.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import piqp
from numpy.typing import NDArray
from scipy import sparse

from services.tracker import model
from services.tracker.ramp import brake, braking_rate, within

if TYPE_CHECKING:
    from services.tracker.limits import Limits

Array = NDArray[np.float64]

_ROUNDING = 1e-6
"""A solution may exceed its bounds by the solver's tolerance; by more than this it is not used."""


@dataclass(frozen=True, slots=True)
class Weights:
    """What a squared error costs over the horizon.

    Attributes:
        progress: of the distance behind the reference.
        lateral: of the distance beside the path.
        heading: of the heading error.
        speed: of the difference from the reference speed.
        turn_rate: of the difference from the path's own turn rate.
        acceleration, turn_acceleration: of each change of a command.
        last: multiplies the errors' weights in the last step.
    """

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
    """Model-predictive control.

    Attributes:
        horizon: steps that are looked ahead.
        step: length of one, seconds.
        lag: of the base, seconds.
        far: lateral errors count as this at most, metres.
        weights: what an error costs.
    """

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
    """What to follow, at the ends of the steps: arclength, speed, curvature, each (horizon + 1,), the first one now.

    ``most`` (horizon,) bounds the speed that may be commanded in each step, where the path bounds it. A robot that is
    faster brakes first.
    """

    s: Array
    v: Array
    curvature: Array
    most: Array | None = None

    def is_known(self) -> bool:
        """Whether every number is one, and ``most`` no speed below zero."""
        finite = np.isfinite([self.s, self.v, self.curvature]).all()
        return bool(finite and (self.most is None or (self.most >= 0.0).all()))


@dataclass(frozen=True, slots=True)
class Command:
    """Speed along the direction of travel and turn rate; ``problem`` says why it is a stop, or is empty."""

    v: float
    w: float
    problem: str = ""


class PathMpc:
    """The controller. Set up once; :meth:`solve` only updates numbers.

    ``limits.lateral_acceleration`` is the business of the reference's speed; all other limits hold in every command.
    """

    def __init__(self, limits: Limits, settings: MpcSettings | None = None) -> None:
        self._limits = limits
        self._settings = settings or MpcSettings()
        self._equalities = model.Equalities(self._settings.horizon, self._settings.step, self._settings.lag)
        self._cost = _diagonal_cost(self._settings)
        self._high = self._upper_bounds()
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
        limits, settings = self._limits, self._settings
        v0, w0 = within(max(state.v_command, 0.0), state.w_command, limits)
        start = np.array([state.s, state.lateral, state.heading, state.v, state.w, v0, w0])
        if not (np.isfinite(start).all() and reference.is_known()):
            return Command(*brake(v0, w0, seconds, limits), "the state or the reference is not finite")
        start[model.E] = min(max(state.lateral, -settings.far), settings.far)
        # Arclength is counted from the robot: hundreds of metres in the numbers cost the solver its precision.
        start[model.S] = 0.0
        A, b = self._equalities.fill(start, reference.v, reference.curvature)
        most = limits.speed if reference.most is None else reference.most
        steps = settings.step * np.arange(1, settings.horizon + 1)
        self._high[:, model.VC] = np.minimum(np.maximum(most, v0 - braking_rate(limits) * steps), limits.speed)
        self._solver.update(c=self._linear_cost(reference, state.s), A=A, b=b, x_u=self._high.ravel())
        status = self._solver.solve()
        if status != piqp.PIQP_SOLVED:
            return Command(*brake(v0, w0, seconds, limits), f"the controller found no solution ({status.name})")
        at_most = math.inf if reference.most is None else float(reference.most[0])
        return self._first_command(v0, w0, seconds, at_most)

    def _first_command(self, v0: float, w0: float, seconds: float, most: float) -> Command:
        """The command after ``seconds`` of the solution's first rates.

        The bounds are convex, so what holds at both ends of the first step holds between them.
        """
        limits = self._limits
        share = min(seconds, self._settings.step)
        a, alpha = (float(value) for value in self._solver.result.x[model.A : model.ALPHA + 1])
        a = min(max(a, -limits.deceleration), limits.acceleration)
        alpha = min(max(alpha, -limits.turn_acceleration), limits.turn_acceleration)
        v, w = v0 + a * share, w0 + alpha * share
        v_in, w_in = within(max(v, 0.0), w, limits)
        if abs(v - v_in) > 1e3 * _ROUNDING or abs(w - w_in) > 1e3 * _ROUNDING:
            return Command(*brake(v0, w0, seconds, limits), "the controller's solution exceeds its limits")
        # The step is longer than the cycle, but a slower stretch begins with this very command.
        v_in = min(v_in, max(most, v0 - braking_rate(limits) * share))
        return Command(*within(v_in, w_in, limits))

    def _linear_cost(self, reference: Reference, origin: float) -> Array:
        """``c`` of ``1/2 x'Px + c'x`` for quadratic costs about the reference."""
        wanted = np.zeros((self._settings.horizon, model.STRIDE))
        wanted[:, model.S] = reference.s[1:] - origin
        wanted[:, model.V] = wanted[:, model.VC] = reference.v[1:]
        wanted[:, model.W] = wanted[:, model.WC] = reference.v[1:] * reference.curvature[1:]
        return -self._cost * wanted.ravel()

    def _upper_bounds(self) -> Array:
        limits = self._limits
        high = np.full((self._settings.horizon, model.STRIDE), np.inf)
        high[:, model.VC], high[:, model.WC] = limits.speed, limits.turn_rate
        high[:, model.A], high[:, model.ALPHA] = limits.acceleration, limits.turn_acceleration
        return high

    def _set_up(self) -> piqp.SparseSolver:
        n, limits = self._settings.horizon, self._limits
        low = np.full((n, model.STRIDE), -np.inf)
        low[:, model.VC], low[:, model.WC] = 0.0, -limits.turn_rate
        low[:, model.A], low[:, model.ALPHA] = -limits.deceleration, -limits.turn_acceleration
        solver = piqp.SparseSolver()
        # Checked rather than trusted: commands in m/s and rad/s need no eighth digit, and each iteration costs.
        solver.settings.eps_abs = solver.settings.eps_rel = _ROUNDING
        solver.settings.preconditioner_reuse_on_update = True
        A, b = self._equalities.fill(np.zeros(model.STATES), np.zeros(n + 1), np.zeros(n + 1))
        P = sparse.csc_matrix(sparse.diags(self._cost))
        c = np.zeros(n * model.STRIDE)
        G, h = _curvature_rows(n, limits.curvature)
        solver.setup(P, c, A, b, G, None, h, low.ravel(), self._high.ravel())
        return solver


def _diagonal_cost(settings: MpcSettings) -> Array:
    """Diagonal of ``P`` (horizon * stride,): the speeds' weights are shared by the motion and by its command."""
    weights, step = settings.weights, np.zeros(model.STRIDE)
    step[model.S], step[model.E], step[model.PSI] = weights.progress, weights.lateral, weights.heading
    step[model.V] = step[model.VC] = 0.5 * weights.speed
    step[model.W] = step[model.WC] = 0.5 * weights.turn_rate
    step[model.A], step[model.ALPHA] = weights.acceleration, weights.turn_acceleration
    cost = np.tile(step, (settings.horizon, 1))
    cost[-1, : model.PSI + 1] *= weights.last
    return cost.ravel()


def _curvature_rows(horizon: int, curvature: float | None) -> tuple[sparse.csc_matrix | None, Array | None]:
    """``+-wc - curvature * vc <= 0`` at every step; nothing without a bound."""
    if curvature is None:
        return None, None
    block = np.zeros((2, model.STRIDE))
    block[:, model.VC], block[:, model.WC] = -curvature, (1.0, -1.0)
    return sparse.csc_matrix(sparse.kron(sparse.eye(horizon), block)), np.zeros(2 * horizon)
