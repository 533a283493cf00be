"""Numbers that no sensor can mean are refused at the border: further in they would poison an estimate."""

import numpy as np
import pytest
from pydantic import ValidationError

from common import messages as m
from common.ids import VertexId, new_map_id

CAMERA = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 32.0, "cy": 24.0, "baseline": 0.2}


@pytest.mark.parametrize(
    "wrong", [{"fx": 1e300}, {"fy": 0.0}, {"cx": -1e9}, {"cy": 1e9}, {"baseline": 1e9}, {"baseline": 0.0}]
)
def test_an_impossible_calibration_is_refused(wrong):
    m.CameraModel(**CAMERA, T_vehicle_camera=np.eye(4))
    with pytest.raises(ValidationError):
        m.CameraModel(**{**CAMERA, **wrong}, T_vehicle_camera=np.eye(4))


@pytest.mark.parametrize("wrong", [{"v": 1e308}, {"w": -1e308}, {"v": 101.0}])
def test_wheels_that_turn_impossibly_fast_are_refused(wrong):
    with pytest.raises(ValidationError):
        m.WheelOdometry(**{"stamp": 1, "v": 1.0, "w": 0.0, **wrong})


def scan(**changed):
    fields = {
        "stamp": 1,
        "T_vehicle_lidar": np.eye(4),
        "ranges": np.full((4, 32), 2.0, np.float32),
        "intensities": np.zeros((4, 32), np.uint8),
        "elevations": np.linspace(0.2, -0.4, 4),
        "azimuths": np.linspace(3.1, -3.1, 32),
        "offsets": np.linspace(-0.1, 0.0, 32),
    }
    return m.LidarScan(**{**fields, **changed})


@pytest.mark.parametrize(
    "form",
    [
        {"elevations": np.zeros((4, 32)), "azimuths": np.zeros((4, 32), np.float32)},
        {"intensities": np.full((4, 32), 65535, np.uint16)},
        {"intensities": np.full((4, 32), 0.5, np.float32)},
        {"ranges": np.zeros((4, 32), np.float32)},
    ],
)
def test_a_scan_has_angles_a_beam_or_a_point_and_intensities_of_several_types(form):
    assert scan(**form).ranges.shape == (4, 32)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges": np.full((4, 32), -0.1, np.float32)},
        {"ranges": np.full((4, 32), np.nan, np.float32)},
        {"ranges": np.full((4, 32), 5e3, np.float32)},
        {"ranges": np.full((4, 32), 2.0)},
        {"ranges": np.full((4, 31), 2.0, np.float32)},
        {"ranges": np.zeros((0, 32), np.float32), "intensities": np.zeros((0, 32), np.uint8)},
        {"ranges": np.zeros(128, np.float32)},
        {"intensities": np.zeros((4, 31), np.uint8)},
        {"intensities": np.full((4, 32), -1.0, np.float32)},
        {"intensities": np.full((4, 32), np.inf, np.float32)},
        {"intensities": np.zeros((4, 32), np.int64)},
        {"elevations": np.linspace(0.2, -0.4, 5)},
        {"elevations": np.full(4, 20.0)},
        {"elevations": np.zeros(4, np.int32)},
        {"elevations": np.full(4, np.nan)},
        {"azimuths": np.zeros((32, 4))},
        {"azimuths": np.full(32, 200.0)},
        {"offsets": np.zeros(31)},
        {"offsets": np.full(32, 5.0)},
        {"T_vehicle_lidar": np.zeros((4, 4))},
    ],
)
def test_a_scan_of_no_lidar_is_refused(wrong):
    with pytest.raises(ValidationError):
        scan(**wrong)


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_an_image_of_a_camera_is_grey_or_coloured(shape):
    assert m.CameraFrame(stamp=1, image=np.zeros(shape, np.uint8)).image.shape == shape


@pytest.mark.parametrize("shape", [(), (64,), (48, 64, 4), (48, 64, 3, 1), (0, 64), (48, 2, 3), (16, 20000)])
def test_what_is_no_image_is_refused(shape):
    with pytest.raises(ValidationError):
        m.CameraFrame(stamp=1, image=np.zeros(shape, np.uint8))


def route(**changed):
    vertices = [VertexId(new_map_id("r1", 0), i) for i in (0, 1)]
    fields = {
        "id": "r", "environment": "park", "goal": "gate", "vertices": vertices,
        "path": np.stack([np.eye(4)] * 2), "length": 0.0, "maps": [], "reason": "the only one",
    }  # fmt: skip
    return m.Route(**{**fields, **changed})


def test_a_route_has_a_speed_limit_for_each_of_its_vertices_or_none():
    assert route().speed_limits == []
    assert route(speed_limits=[0.5, 1000.0]).speed_limits == [0.5, 1000.0]


@pytest.mark.parametrize("wrong", [[0.5], [0.5] * 3, [0.5, 0.0], [0.5, -1.0], [np.nan, 0.5], [0.5, np.inf]])
def test_speed_limits_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValidationError):
        route(speed_limits=wrong)
