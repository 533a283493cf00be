"""What ``vtr doctor`` checks of a stereo camera's calibration: whether such a pair can exist."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cli.doctor.check import Check
from common.config import RobotConfig
from common.errors import ConfigurationError
from services.sensors.calibration.file import MountingTable, load
from services.sensors.calibration.rig import Lens, StereoRig
from services.sensors.settings import Settings

_NARROWEST, _WIDEST = np.radians(15.0), np.radians(150.0)
_SQUARE = 0.1
"""Parts by which the focal lengths of one lens, or of two of a kind, may differ."""
_CENTRE = 0.25
_SHORTEST_M, _LONGEST_M = 0.02, 2.0
_MOST_TURN = np.radians(15.0)

_AGAIN = "calibrate again: vtr calibrate"


def check_calibration(configuration: RobotConfig) -> Check:
    """Whether the calibration that the driver ``cameras`` needs is there, and one that a pair of cameras can have."""
    settings = configuration.settings("sensors", Settings)
    if settings.driver != "cameras":
        return Check("calibration", "ok", f"the driver '{settings.driver}' needs none")
    if settings.calibration is None:
        return Check(
            "calibration", "fail", "[sensors] names no calibration", "make one: vtr calibrate -o calibration.toml"
        )
    path = configuration.path.absolute().parent / settings.calibration
    try:
        stored = load(path)
    except ConfigurationError as error:
        return Check("calibration", "fail", str(error), _AGAIN)
    if wrong := next(implausible(stored.rig), None):
        return Check("calibration", "fail", f"{path}: {wrong}", _AGAIN)
    rig = stored.rig
    text = f"{path}: {rig.width}x{rig.height}, baseline {np.linalg.norm(rig.T):.3f} m"
    if stored.mounting == MountingTable():
        advice = "measure where the left camera sits, and write it into [calibration.mounting]"
        return Check("calibration", "warn", f"{text}, mounted at the vehicle's own origin", advice)
    return Check("calibration", "ok", text)


def implausible(rig: StereoRig) -> Iterator[str]:
    """What no real pair of cameras has, a sentence each."""
    for side, lens in (("left", rig.left), ("right", rig.right)):
        yield from _of_a_lens(side, lens, rig.width, rig.height)
    if abs(rig.left.fx / rig.right.fx - 1.0) > _SQUARE:
        yield f"the two lenses differ: {rig.left.fx:.0f} and {rig.right.fx:.0f} pixels"
    baseline = float(np.linalg.norm(rig.T))
    if not _SHORTEST_M < baseline < _LONGEST_M:
        yield f"the cameras would be {baseline:.3g} m apart: was the board's square given in metres?"
    if abs(rig.T[0]) < np.linalg.norm(rig.T[1:]):
        yield "the cameras would not sit side by side"
    if rig.T[0] > 0.0:
        yield "the left camera would sit to the right: exchange the devices, or set right_first"
    turn = np.arccos(np.clip((np.trace(rig.R) - 1.0) / 2.0, -1.0, 1.0))
    if turn > _MOST_TURN:
        yield f"the cameras would look {np.degrees(turn):.0f} degrees apart"


def _of_a_lens(side: str, lens: Lens, width: int, height: int) -> Iterator[str]:
    view = 2.0 * np.arctan(width / (2.0 * lens.fx))
    if not _NARROWEST < view < _WIDEST:
        yield f"the {side} camera would see {np.degrees(view):.0f} degrees"
    if abs(lens.fx / lens.fy - 1.0) > _SQUARE:
        yield f"the {side} camera's pixels would not be square: fx is {lens.fx:.0f} and fy {lens.fy:.0f}"
    for what, centre, size in (("cx", lens.cx, width), ("cy", lens.cy, height)):
        if abs(centre / size - 0.5) > _CENTRE:
            yield f"the {side} camera's {what} is {centre:.0f}, far from the middle of its {size} pixels"
