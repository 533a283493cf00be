"""Speeded-Up Robust Features: detection, description and matching, as a library of arrays.

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, *Speeded-Up Robust Features (SURF)*, Computer Vision and Image
Understanding 110(3), 2008. ``integral`` -> ``detector`` -> ``selection`` -> ``orientation`` -> ``descriptor``, and
``matching`` of two images' features.
"""

from services.estimator.surf.extraction import detect_and_describe
from services.estimator.surf.features import SurfError, SurfFeatures
from services.estimator.surf.matching import SurfMatches, Window, match
from services.estimator.surf.settings import SurfSettings

__all__ = [
    "SurfError",
    "SurfFeatures",
    "SurfMatches",
    "SurfSettings",
    "Window",
    "detect_and_describe",
    "match",
]
