"""The error of a set of images from which nothing sound can be computed."""

from __future__ import annotations

from common.errors import RetraverseError


class CalibrationError(RetraverseError):
    """The images, or what was found from them, are no basis for a calibration; the sentence says why and what to do."""
