"""Keys, tokens, qualities of service, attachments and hashes are those of an independent implementation."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import attachment as sdk_attachment
from zenoh_ros2_sdk import entity, keyexpr, utils
from zenoh_ros2_sdk.message_registry import MessageRegistry
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability

from services.sensors.ros2 import names, types
from services.sensors.ros2.attachment import Attachment, gid_of
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.qos import DEFAULT, LATCHED, SENSOR_DATA, Qos
from tests.ros import ROOTS, write_definitions

_WORD = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
_TOPIC = st.lists(_WORD, min_size=1, max_size=4).map(lambda words: "/" + "/".join(words))


@given(_TOPIC, st.sampled_from(ROOTS), st.integers(0, 232))
def test_a_topics_key_is_the_sdks(topic, type_name, domain):
    key = names.topic_key(domain, topic, names.dds_type(type_name), "RIHS01_00")
    assert key == keyexpr.topic_keyexpr(domain, topic, utils.ros2_to_dds_type(type_name), "RIHS01_00")
    assert names.ros_type(names.dds_type(type_name)) == type_name


@given(_TOPIC, st.one_of(st.just("/"), _TOPIC), _WORD, st.sampled_from(["MP", "MS"]))
def test_tokens_are_the_sdks_and_can_be_read(topic, namespace, name, kind):
    dds = names.dds_type("geometry_msgs/msg/Twist")
    node = names.Node(7, "0a1b", namespace, name)
    theirs = entity.NodeEntity(7, "0a1b", 0, name, namespace)
    assert node.token() == keyexpr.node_liveliness_keyexpr(theirs)
    token = node.endpoint_token(3, kind, names.Endpoint(topic, dds, "RIHS01_00", SENSOR_DATA))
    ends = entity.EndpointEntity(theirs, 3, entity.EntityKind(kind), topic, dds, "RIHS01_00", SENSOR_DATA.encode())
    assert token == keyexpr.endpoint_liveliness_keyexpr(ends)
    assert names.read_token(token) == names.Told(kind, name, topic, dds, "RIHS01_00")
    assert names.read_token(node.token()) is None


@pytest.mark.parametrize("qos", [DEFAULT, SENSOR_DATA, LATCHED, Qos(reliable=False, latched=True, depth=3)])
def test_a_quality_of_service_is_read_as_what_it_is(qos):
    read = QosProfile.decode(qos.encode())
    assert (read.reliability is QosReliability.RELIABLE) == qos.reliable
    assert (read.durability is QosDurability.TRANSIENT_LOCAL) == qos.latched
    assert read.history_depth == qos.depth


@given(st.integers(0, 2**62), st.integers(0, 2**62), st.binary(min_size=16, max_size=16))
def test_an_attachment_is_the_sdks(sequence, stamp, gid):
    ours = Attachment(sequence, stamp, gid)
    assert ours.pack() == sdk_attachment.Attachment(sequence, stamp, gid).to_bytes()
    assert Attachment.unpack(ours.pack()) == ours


@pytest.mark.parametrize("data", [b"", bytes(16), bytes(33), bytes(16) + b"\x11" + bytes(17)])
def test_what_is_no_attachment_is_refused(data):
    with pytest.raises(RosDataError):
        Attachment.unpack(data)


def test_hashes_of_types_are_those_that_the_sdk_computes_from_the_definitions(tmp_path):
    write_definitions(tmp_path)
    registry = MessageRegistry(str(tmp_path))
    for name in ROOTS:
        text = registry.get_msg_file_path(name).read_text()
        theirs = utils.get_type_hash(name, text, utils.load_dependencies_recursive(name, text, registry))
        assert types.hash_of(name, "jazzy") == theirs
        assert types.hash_of(name, "humble") == "TypeHashNotSupported"


@pytest.mark.parametrize(
    "release",
    [Stores.ROS2_HUMBLE, Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL],
)
def test_all_releases_of_ros_mean_the_same_by_these_types(release):
    store = get_typestore(release)
    for name in ROOTS:
        assert store.hash_rihs01(name) == types.hash_of(name, "jazzy")


def test_ids_of_endpoints_differ_and_last():
    assert gid_of("a") == gid_of("a") != gid_of("b")
    assert len(gid_of("a")) == 16


@pytest.mark.parametrize(
    ("name", "namespace", "absolute"),
    [("odom", "/", "/odom"), ("/odom", "/r1", "/odom"), ("a/b", "r1", "/r1/a/b"), ("a", "/r1/", "/r1/a")],
)
def test_a_relative_name_is_below_the_namespace(name, namespace, absolute):
    assert names.resolve(name, namespace) == absolute
    assert names.bridge_key(absolute) == absolute[1:]


def test_a_camera_info_is_beside_its_images():
    assert names.sibling("left/image_rect", "camera_info") == "left/camera_info"
    assert names.sibling("/cam/left/image_raw/compressed", "camera_info") == "/cam/left/camera_info"
    assert names.sibling("image", "camera_info") == "camera_info"


@pytest.mark.parametrize("name", ["**", "a/*", "a//b", "a/", "1a", "~a", "a b", "a$*", "é"])
def test_what_is_no_name_is_refused(name):
    with pytest.raises(ValueError, match="no ROS name"):
        names.check_name(name, "left")
