"""What a configuration of a ROS robot may say."""

import pytest

from common import config
from common.errors import ConfigurationError
from services.sensors.settings import Settings

STEREO = '[sensors.ros2.inputs]\nleft = "left/image_rect"\nright = "right/image_rect/compressed"\n'


def loaded(folder, text):
    path = folder / "robot.toml"
    path.write_text(f'[robot]\nname = "r1"\n[sensors]\ndriver = "ros2"\n{text}')
    return config.load(path).settings("sensors", Settings).ros2


def test_a_robot_with_two_images_is_enough(tmp_path):
    found = loaded(tmp_path, STEREO)
    assert found.inputs.infos == ("left/camera_info", "right/camera_info")
    assert found.outputs.command == "cmd_vel"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "name left and right, image, or points"),
        ('[sensors.ros2.inputs]\nleft = "a"\n', "both, or neither"),
        ('[sensors.ros2.inputs]\nimage = "a/**"\n', "no ROS name"),
        (f'[sensors.ros2]\nendpoint = "localhost"\n{STEREO}', "tcp/192.168.1.2:7447"),
        (f"[sensors.ros2]\ndomain = 233\n{STEREO}", "0 to 232"),
        (f'[sensors.ros2]\ntransport = "dds"\n{STEREO}', "rmw_zenoh"),
        (f'[sensors.ros2]\nnode = "a/b"\n{STEREO}', "slash"),
        (f"[sensors.ros2]\ndead_man = 40\n{STEREO}", "0 to 31"),
        (f"[sensors.ros2]\ntolerance = 2.0\n{STEREO}", "below 1"),
        (f'[sensors.ros2.frames]\nroute = "odom"\n{STEREO}', "four names"),
        (f'[sensors.ros2]\nend_point = "tcp/a:1"\n{STEREO}', "endpoint"),
    ],
)
def test_what_means_nothing_is_one_sentence(tmp_path, text, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        loaded(tmp_path, text)
