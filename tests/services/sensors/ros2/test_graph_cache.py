"""What is said of a graph in which something is missing."""

from services.sensors.ros2.graph_cache import GraphCache
from services.sensors.ros2.names import Endpoint, Node, dds_type
from services.sensors.ros2.qos import DEFAULT
from services.sensors.ros2.types import TWIST, TWIST_STAMPED

BASE = Node(0, "0a", "/", "base")
OURS = Endpoint("/cmd_vel", dds_type(TWIST), "RIHS01_aa", DEFAULT)


def graph(*endpoints, kind="MS"):
    made = GraphCache("retraverse")
    for number, endpoint in enumerate(endpoints):
        made.told(BASE.endpoint_token(number, kind, endpoint), True)
    return made


def test_a_base_that_listens_is_no_matter():
    assert graph(OURS).why_unheard(OURS) is None


def test_a_base_that_wants_stamps_or_another_ros_is_named():
    other = Endpoint("/cmd_vel", dds_type(TWIST_STAMPED), "RIHS01_aa", DEFAULT)
    assert "'base' listens to it as geometry_msgs/msg/TwistStamped" in graph(other).why_unheard(OURS)
    humble = Endpoint("/cmd_vel", dds_type(TWIST), "TypeHashNotSupported", DEFAULT)
    assert "distro" in graph(humble).why_unheard(OURS)
    assert "nobody listens" in graph(OURS, kind="MP").why_unheard(OURS)


def test_why_nothing_comes_is_told_apart():
    other = Endpoint("/cmd_vel", dds_type(TWIST_STAMPED), "RIHS01_aa", DEFAULT)
    elsewhere = Endpoint("/other", dds_type(TWIST), "RIHS01_aa", DEFAULT)
    assert "no node" in graph().why_silent(OURS)
    assert "nobody publishes" in graph(elsewhere, kind="MP").why_silent(OURS)
    assert "TwistStamped, not as geometry_msgs/msg/Twist" in graph(other, kind="MP").why_silent(OURS)
    assert "sends nothing" in graph(OURS, kind="MP").why_silent(OURS)


def test_who_leaves_is_forgotten_and_the_driver_itself_does_not_count():
    made = graph(OURS)
    made.told(BASE.endpoint_token(0, "MS", OURS), False)
    made.told(Node(0, "0b", "/", "retraverse").endpoint_token(1, "MS", OURS), True)
    made.told("@ros2_lv/nonsense", True)
    assert "nobody listens" in made.why_unheard(OURS)
