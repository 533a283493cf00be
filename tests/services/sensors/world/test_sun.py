from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from services.sensors.world.sun import air_mass, daylight, direction, sun_angles


# NREL's solar position algorithm prints this example (Reda and Andreas, NREL/TP-560-34302, appendix A.5);
# the others are a solstice and an equinox, where the declination is known to be 23.44 and 0 degrees.
@pytest.mark.parametrize(
    ("time", "latitude", "longitude", "azimuth", "elevation"),
    [
        (datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7))), 39.742476, -105.1786, 194.34, 39.87),
        (datetime(2026, 6, 21, 12, 1, 50, tzinfo=UTC), 50.0, 0.0, 180.0, 63.44),
        (datetime(2026, 12, 21, 11, 58, 0, tzinfo=UTC), 50.0, 0.0, 180.0, 16.56),
        (datetime(2026, 3, 20, 14, 46, 0, tzinfo=UTC), 0.0, -39.7, 90.0, 89.9),
    ],
)
def test_sun_stands_where_the_almanac_says(time, latitude, longitude, azimuth, elevation):
    az, el = np.degrees(sun_angles(time, latitude, longitude))
    assert el == pytest.approx(elevation, abs=0.15)
    if elevation < 89.0:
        assert az == pytest.approx(azimuth, abs=0.3)


def test_sun_rises_in_the_east_and_sets_in_the_west():
    morning = direction(*sun_angles(datetime(2026, 3, 20, 6, 30, tzinfo=UTC), 50.0, 0.0))
    evening = direction(*sun_angles(datetime(2026, 3, 20, 17, 30, tzinfo=UTC), 50.0, 0.0))
    assert morning[0] > 0.9
    assert evening[0] < -0.9


def test_a_time_without_a_zone_is_refused():
    with pytest.raises(ValueError, match="time zone"):
        sun_angles(datetime(2026, 6, 21, 12), 50.0, 0.0)  # noqa: DTZ001


@pytest.mark.parametrize(("degrees", "mass"), [(90.0, 1.0), (30.0, 1.99), (10.0, 5.58), (0.0, 37.92)])
def test_air_mass_follows_kasten_and_young(degrees, mass):
    assert air_mass(np.radians(degrees)) == pytest.approx(mass, rel=0.01)


def test_low_sun_is_weaker_and_redder_and_night_is_dark():
    noon, evening, night = (daylight(datetime(2026, 6, 21, h, tzinfo=UTC), 50.0, 14.4) for h in (11, 18, 23))
    assert 5200 < noon.sun_temperature < 5600
    assert evening.sun_temperature < noon.sun_temperature - 800
    assert evening.sun_irradiance < 0.7 * noon.sun_irradiance
    assert noon.sky_temperature > 10000
    assert night.sun_irradiance == 0.0
    assert night.sky_irradiance < 1e-3 * noon.sky_irradiance
