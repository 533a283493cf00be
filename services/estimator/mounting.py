"""Between a sensor's frames and those of the vehicle that carries it."""

from __future__ import annotations

from common import geometry
from common.geometry import Array, Uncertain


def in_vehicle_frames(T_a_b: Uncertain, T_vehicle_sensor: Array) -> Uncertain:
    """A motion of the sensor as the motion of the vehicle that carries it, covariance included."""
    mounting = Uncertain.exactly(T_vehicle_sensor)
    return mounting @ T_a_b @ mounting.inverse()


def in_sensor_frames(T_a_b: Uncertain, T_vehicle_sensor: Array) -> Uncertain:
    """Inverse of :func:`in_vehicle_frames`."""
    return in_vehicle_frames(T_a_b, geometry.inverse(T_vehicle_sensor))
