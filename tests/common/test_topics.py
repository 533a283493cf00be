from __future__ import annotations

import math

import pytest

from common import messages, topics
from common.topics import Delivery, Topic

SERVICES = {"router", "sensors", "estimator", "planner", "tracker", "safety", "navigator", "mapstore", "obstacles"}
OTHERS = {"base", "player", "console", "operator"}

every_topic = pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.key)


def test_keys_are_unique_and_none_hides_another():
    assert len({topic.key for topic in topics.ALL}) == len(topics.ALL) > 15
    plain = {topic.key for topic in topics.ALL if "{" not in topic.key}
    for topic in topics.ALL:
        prefix = topic.key.partition("{")[0]
        assert topic.key in plain or not [key for key in plain if key.startswith(prefix)]


def test_every_message_is_used():
    every = topics.ALL + topics.OF_THE_FLEET
    used = {topic.message for topic in every} | {topic.answer for topic in every}
    parts = set()
    waiting = [model for model in used if model]
    while waiting:
        model = waiting.pop()
        if model not in parts:
            parts.add(model)
            text = str({name: field.annotation for name, field in model.model_fields.items()})
            waiting += [m for m in messages.Message.__subclasses__() if f".{m.__name__}" in text]
    on_the_bus = {
        model for model in messages.Message.__subclasses__() if model.__module__.startswith("common.messages")
    }
    assert on_the_bus <= parts


@every_topic
def test_a_query_has_an_answer_and_a_sample_has_none(topic: Topic):
    assert (topic.answer is not None) == (topic.delivery is Delivery.QUERY)


@every_topic
def test_owners_are_processes(topic: Topic):
    assert topic.owners == ("*",) or set(topic.owners) <= SERVICES | OTHERS
    if topic.delivery is Delivery.QUERY:
        assert len(topic.owners) == 1


@every_topic
def test_a_sample_grows_stale_after_several_periods_and_not_before(topic: Topic):
    if topic.rate_hz and math.isfinite(topic.max_age_s):
        assert 3 <= topic.max_age_s * topic.rate_hz <= 30
    if topic.delivery is Delivery.FRAME:
        assert topic.rate_hz > 0
        assert math.isfinite(topic.max_age_s)


@every_topic
def test_states_wait_for_room_and_frames_do_not(topic: Topic):
    if topic.delivery is not Delivery.QUERY:
        assert topic.blocking == (topic.delivery is Delivery.STATE)


def test_the_fleet_has_its_own_keys():
    assert topics.MODEL.at("r1", "park") == topics.MODEL.at("r2", "park") == "vtr/fleet/park/model"
    assert {topic.owners for topic in topics.OF_THE_FLEET} == {(topics.FLEET,)}


def test_the_base_hears_safety_alone():
    assert topics.SAFE.owners == ("safety",)
    assert topics.SAFE.rate_hz == 50


def test_a_key_names_its_robot_and_its_sensor():
    assert topics.STEREO.at("r1", "front") == "vtr/r1/sensor/stereo/front"
    assert topics.STATE.at("r2") == "vtr/r2/state"
