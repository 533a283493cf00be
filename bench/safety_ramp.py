"""What safety's bound on jerk costs: the delay of a tracker's commands through the ramp, beside no bound on jerk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench import table
from services.safety.ramp import Ramp, RampSettings

Array = NDArray[np.float64]

_PERIOD_S = 0.02
_DEFAULT = RampSettings()
_FREE = RampSettings(jerk=1e9, turn_jerk=1e9)
_ROUND = RampSettings(jerk=10.0, turn_jerk=30.0)
_DELAYS = np.arange(0.0, 0.3, 0.001)


def main() -> None:
    """Prints delay and greatest jerk by the rate of the commands and the bound."""
    rows: list[list[object]] = []
    for rate in (10, 20):
        for name, settings in (("none", _FREE), ("default", _DEFAULT), ("10 m/s^3, 30 rad/s^3", _ROUND)):
            rows.append([f"{rate} Hz", name, *_pass(rate, settings)])
    table.show(
        "Safety's ramp: a tracker's profile to 1.2 m/s at 0.5 m/s^2, turning at up to 0.6 rad/s",
        ["commands", "bound on jerk", "delay, ms", "turning", "greatest jerk, m/s^3", "rad/s^3"],
        rows,
        "delay against the profile before it was sampled; at 10 and 20 Hz, holding a command costs 50 and 25 ms alone",
    )


def _pass(rate: int, settings: RampSettings) -> list[float]:
    """Delay in ms and greatest jerk of both axes: delay v, delay w, jerk v, jerk w."""
    time = np.arange(0.0, 10.0, _PERIOD_S)
    wanted = np.stack([np.clip(np.minimum(time, 10.0 - time) / 2.0, 1e-3, 1.2), 0.6 * np.sin(time * np.pi / 2.0)], 1)
    sent = (np.floor(time * rate + 1e-9) / (rate * _PERIOD_S)).round().astype(int)
    ramp = Ramp(settings)
    out = np.array([ramp.follow(*wanted[i], _PERIOD_S) for i in sent])
    delays = [_delay(time, wanted[:, axis], out[:, axis]) for axis in (0, 1)]
    jerks = np.abs(np.diff(out, 2, axis=0)).max(axis=0) / _PERIOD_S**2
    return [*delays, *map(float, jerks)]


def _delay(time: Array, wanted: Array, out: Array) -> float:
    """The delay (ms) at which the output is most like the profile, by least squares."""
    errors = [float(np.sum((np.interp(time - delay, time, wanted) - out) ** 2)) for delay in _DELAYS]
    return float(_DELAYS[int(np.argmin(errors))]) * 1e3


if __name__ == "__main__":
    main()
