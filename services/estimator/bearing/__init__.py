"""Bearing-only teach and repeat: one uncalibrated camera and wheel odometry (the thesis's VT&R, section 2.1).

Teaching keeps images and the commands that were obeyed between them. Repeating keeps track of the distance along the
map and of the heading by comparing the live image with the stored ones; no metric pose is claimed, and none is needed:
who holds the taught heading towards what is seen comes back to the taught path.
"""

from services.estimator.bearing.pipeline import BearingPipeline
from services.estimator.bearing.route_localizer import BearingRouteLocalizer
from services.estimator.bearing.settings import BearingSettings

__all__ = ["BearingPipeline", "BearingRouteLocalizer", "BearingSettings"]
