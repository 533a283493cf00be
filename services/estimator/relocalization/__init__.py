"""Relocalisation without a prior: a robot that is switched on anywhere on a taught network finds itself."""

from services.estimator.relocalization.appearance import appearance_of
from services.estimator.relocalization.finder import Finder, PlaceUnknown
from services.estimator.relocalization.index import AppearanceIndex, warm_up
from services.estimator.relocalization.relocalizer import Found, NotFound, Relocalizer
from services.estimator.relocalization.settings import RelocalizationSettings

__all__ = [
    "AppearanceIndex",
    "Finder",
    "Found",
    "NotFound",
    "PlaceUnknown",
    "RelocalizationSettings",
    "Relocalizer",
    "appearance_of",
    "warm_up",
]
