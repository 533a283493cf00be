"""The particle filter: distance along the map, and heading offset, which is the horizontal shift in radians.

A particle says where along the taught way the robot is, and how far to the left of the taught heading the scene says
that it looks. Wheels move particles on, images weigh them (equation 3.4 of the thesis, at the particle's own shift).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.geometry import Array
from services.estimator.bearing.settings import ParticleSettings

_TURNING = 0.3
"""Metres that a radian counts for where motion makes particles less sure."""

Yaw = Callable[[Array], Array]
"""The taught heading (K,) at distances (K,) along the map."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Mean (2,) and covariance (2, 2) of distance along the map, metres, and heading offset, radians."""

    mean: Array
    covariance: Array

    @property
    def metres(self) -> float:
        """Distance along the map."""
        return float(self.mean[0])

    @property
    def heading(self) -> float:
        """Heading offset, positive where the robot looks further left than it was taught."""
        return float(self.mean[1])

    @property
    def sigmas(self) -> tuple[float, float]:
        """Standard deviations of distance and heading offset."""
        distance, heading = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return float(distance), float(heading)


class ParticleFilter:
    """N particles ``metres`` (N,) and ``heading`` (N,) with weights; the same seed gives the same particles."""

    def __init__(self, settings: ParticleSettings | None = None, seed: int = 0) -> None:
        self._settings = settings or ParticleSettings()
        self._rng = np.random.default_rng(seed)
        self.metres: Array = np.zeros(self._settings.count)
        self.heading: Array = np.zeros(self._settings.count)
        self.weights: Array = self._equal()

    def start(self, metres: float, heading: float, sigmas: tuple[float, float]) -> None:
        """Begins about one place, with standard deviations of distance and heading offset."""
        noise = self._rng.standard_normal((2, self._settings.count))
        self.metres = metres + sigmas[0] * noise[0]
        self.heading = heading + sigmas[1] * noise[1]
        self.weights = self._equal()

    def spread(self, metres: Array, heading: Array, similarity: Array) -> None:
        """Begins anywhere on a grid of S distances and H heading offsets, as likely as ``similarity`` (S, H) says."""
        likely = self._likelihood(similarity.ravel())
        chosen = self._draw(likely / likely.sum())
        jitter = self._rng.uniform(-0.5, 0.5, (2, len(chosen)))
        row, column = np.divmod(chosen, len(heading))
        self.metres = metres[row] + jitter[0] * _spacing(metres)
        self.heading = heading[column] + jitter[1] * _spacing(heading)
        self.weights = self._equal()

    def sprinkle(self, metres: Array, heading: Array, similarity: Array, share: float) -> None:
        """Moves a share of the particles to places of such a grid, as likely as it says.

        Without them a filter that has settled on a wrong peak would never look at another one.
        """
        count = self._rng.binomial(self._settings.count, min(share, 1.0))
        if count == 0:
            return
        likely = self._likelihood(similarity.ravel())
        drawn = self._rng.choice(likely.size, count, p=likely / likely.sum())
        replaced = self._rng.choice(self._settings.count, count, replace=False)
        row, column = np.divmod(drawn, len(heading))
        self.metres[replaced], self.heading[replaced] = metres[row], heading[column]
        self.weights[replaced] = 1.0 / self._settings.count

    def predict(self, metres: float, turn: float, yaw: Yaw) -> None:
        """Moves on by wheel odometry: metres along the way and radians to the left, against the taught turn there."""
        s = self._settings
        noise = self._rng.standard_normal((2, len(self.metres))) * np.sqrt(abs(metres) + _TURNING * abs(turn))
        before = yaw(self.metres)
        self.metres = self.metres + metres + s.distance_noise * noise[0]
        self.heading = self.heading + turn - (yaw(self.metres) - before) + s.heading_noise * noise[1]

    def blur(self, metres: float, heading: float) -> None:
        """Knows less, by standard deviations of distance and heading offset, of a motion that nothing measured."""
        noise = self._rng.standard_normal((2, len(self.metres)))
        self.metres = self.metres + metres * noise[0]
        self.heading = self.heading + heading * noise[1]

    def weigh(self, similarity: Array, metres: float) -> None:
        """Weighs by the similarity (N,) at each particle, and draws anew where few particles are left that weigh.

        ``metres`` is the way since the image before: images taken close together share most of their errors, so that a
        robot which stands learns little more from looking again.
        """
        news = min(abs(metres) / self._settings.independence, 1.0)
        self.weights = self.weights * self._likelihood(similarity) ** news
        self.weights = self.weights / self.weights.sum()
        if self.effective < self._settings.effective * len(self.weights):
            chosen = self._draw(self.weights)
            self.metres, self.heading = self.metres[chosen], self.heading[chosen]
            self.weights = self._equal()

    @property
    def effective(self) -> float:
        """Effective sample size: as many particles of one weight would know as much."""
        return float(1.0 / np.square(self.weights).sum())

    def estimate(self) -> Estimate:
        """The particles' weighted mean and covariance."""
        states = np.stack([self.metres, self.heading])
        mean = states @ self.weights
        apart = states - mean[:, None]
        return Estimate(mean, (apart * self.weights) @ apart.T)

    def _likelihood(self, similarity: Array) -> Array:
        return np.asarray(np.exp((similarity - similarity.max()) / self._settings.temperature))

    def _draw(self, weights: Array) -> Array:
        """Indices of as many particles as there are, by low-variance resampling (Thrun, Burgard and Fox, table 4.4)."""
        count = self._settings.count
        places = (self._rng.uniform() + np.arange(count)) / count
        return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)

    def _equal(self) -> Array:
        return np.full(self._settings.count, 1.0 / self._settings.count)


def _spacing(values: Array) -> float:
    return float(values[1] - values[0]) if len(values) > 1 else 0.0
