"""Numbers that no sensor can mean are refused at the border: further in they would poison an estimate."""

import numpy as np
import pytest
from pydantic import ValidationError

from common import messages as m

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
