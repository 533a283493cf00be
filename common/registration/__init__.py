"""Registration of two images by horizontal shift: how far the scene has moved from a stored to a live image.

A representation turns an image into channels over a grid (:mod:`gradients`, or a network's, :mod:`network`); its
similarity to another's over all shifts (:mod:`correlation`) has a peak, and :mod:`register` says where, how high and
how sure.
"""

from common.registration.correlation import Prepared
from common.registration.gradients import OF_THUMBNAILS, GradientRepresentation, GradientSettings
from common.registration.network import NetworkRepresentation
from common.registration.register import Registrar, Registration, register
from common.registration.representation import Described, Representation

__all__ = [
    "OF_THUMBNAILS",
    "Described",
    "GradientRepresentation",
    "GradientSettings",
    "NetworkRepresentation",
    "Prepared",
    "Registrar",
    "Registration",
    "Representation",
    "register",
]
