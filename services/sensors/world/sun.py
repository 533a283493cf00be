"""Where the sun stands, and how strong and how warm its light is."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from common.geometry import Array

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
ZENITH_TEMPERATURE = 5500.0
"""Colour temperature of the sun at the zenith, kelvin."""
SKY_TEMPERATURE = 12000.0
"""Colour temperature of clear sky, kelvin."""


def sun_angles(time: datetime, latitude: float, longitude: float) -> tuple[float, float]:
    """Azimuth from north over east, and true elevation without refraction, radians.

    ``time`` has a time zone; latitude and longitude in degrees. The Astronomical Almanac's low-precision
    formulae as in Michalsky, *The Astronomical Almanac's algorithm for approximate solar position
    (1950-2050)*, Solar Energy 40(3), 1988: good to 0.01 degrees.

    Raises:
        ValueError: ``time`` has no time zone.
    """
    if time.tzinfo is None:
        raise ValueError("the sun's position needs a time with a time zone")
    days = (time - _J2000).total_seconds() / 86400.0
    mean_longitude = np.radians((280.460 + 0.9856474 * days) % 360.0)
    anomaly = np.radians((357.528 + 0.9856003 * days) % 360.0)
    ecliptic = mean_longitude + np.radians(1.915) * np.sin(anomaly) + np.radians(0.020) * np.sin(2.0 * anomaly)
    obliquity = np.radians(23.439 - 4e-7 * days)
    right_ascension = np.arctan2(np.cos(obliquity) * np.sin(ecliptic), np.cos(ecliptic))
    declination = np.arcsin(np.sin(obliquity) * np.sin(ecliptic))
    # Greenwich mean sidereal time for any instant, not only 0 h: the fraction of the day is inside `days`.
    sidereal = np.radians((280.46062 + 360.98564737 * days + longitude) % 360.0)
    hour, lat = sidereal - right_ascension, np.radians(latitude)
    elevation = np.arcsin(np.sin(lat) * np.sin(declination) + np.cos(lat) * np.cos(declination) * np.cos(hour))
    east = -np.cos(declination) * np.sin(hour)
    north = np.sin(declination) * np.cos(lat) - np.cos(declination) * np.sin(lat) * np.cos(hour)
    return float(np.arctan2(east, north) % (2.0 * np.pi)), float(elevation)


def direction(azimuth: float, elevation: float) -> Array:
    """Unit vector (3,) towards the sun in a frame with x east, y north, z up."""
    c = np.cos(elevation)
    return np.array([np.sin(azimuth) * c, np.cos(azimuth) * c, np.sin(elevation)])


def air_mass(elevation: float) -> float:
    """Relative optical air mass (Kasten and Young, *Applied Optics* 28, 1989), 38 at the horizon and below."""
    degrees = max(0.0, float(np.degrees(elevation)))
    return float(1.0 / (np.sin(np.radians(degrees)) + 0.50572 * (degrees + 6.07995) ** -1.6364))


@dataclass(frozen=True, slots=True)
class Daylight:
    """The two lights of a clear day.

    Attributes:
        direction: (3,) unit vector towards the sun.
        elevation: radians.
        sun_irradiance: on a surface that faces the sun, W/m^2; 0 once the sun has set.
        sun_temperature: kelvin.
        sky_irradiance: of the whole sky on level ground, W/m^2.
        sky_temperature: kelvin.
    """

    direction: Array
    elevation: float
    sun_irradiance: float
    sun_temperature: float
    sky_irradiance: float
    sky_temperature: float


def daylight(time: datetime, latitude: float, longitude: float) -> Daylight:
    """The light at a time and place.

    The direct beam follows Meinel's ``1353 * 0.7^(AM^0.678)`` W/m^2 (*Applied Solar Energy*, 1976). Its
    colour temperature falls by a constant number of mireds (10^6 / K) an air mass, as a filter's does.
    """
    azimuth, elevation = sun_angles(time, latitude, longitude)
    mass = air_mass(elevation)
    # The disc, half a degree wide, rises and sets over a quarter of a degree either side of the horizon.
    risen = float(np.clip(0.5 + np.degrees(elevation) / 0.53, 0.0, 1.0))
    sun = 1353.0 * 0.7 ** (mass**0.678) * risen
    mireds = 1e6 / ZENITH_TEMPERATURE + 20.0 * (min(mass, 14.0) - 1.0)
    return Daylight(
        direction=direction(azimuth, elevation),
        elevation=elevation,
        sun_irradiance=float(sun),
        sun_temperature=1e6 / mireds,
        sky_irradiance=_sky(elevation),
        sky_temperature=SKY_TEMPERATURE,
    )


def _sky(elevation: float) -> float:
    """Diffuse irradiance, W/m^2: up to 180 by day, a part of it from clouds.

    In twilight it falls by a factor of ten every 2.5 degrees.
    """
    degrees = float(np.degrees(elevation))
    if degrees >= 0.0:
        return float(18.0 + 162.0 * np.sqrt(np.sin(elevation)))
    return float(18.0 * 10.0 ** (max(degrees, -18.0) / 2.5))
