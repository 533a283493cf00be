"""What the page tells: the thesis's tables, the figures of ``vtr env``, and a sentence where there is no plan."""

import json

import numpy as np
import pytest

from cli.__main__ import run
from common.environment import Environment, Theta
from common.environment.model import environment_json, parse_time
from common.environment.table import hours_of
from common.environment.told import map_told
from services.console.channel import encode
from services.console.fleet import told
from services.console.fleet.choice import Question
from services.console.fleet.snapshot import Known
from tests.common.environment.test_costs import TABLE_4_5, TABLES_4_9_TO_4_13
from tests.common.environment.thesis import EXPERIMENT_2, EXPERIMENT_3
from tests.services.console.fleet.standin import entries, model, names

AT = "2023-05-08 16:00:00"
ROBUST = (1.0, 0.0, 0.0)


def known(rows, **told_of):
    return Known("campus", 1, tuple(entries(rows, **told_of)), model())


def question(start, goal, at=AT, theta=ROBUST, **more):
    return Question(hours_of(parse_time(at)), Theta(*theta), start=start, goal=goal, **more)


def figures(known, asked, has=""):
    answer = told.costs_told(known, "", asked, has)
    assert json.loads(encode(answer)) == json.loads(json.dumps(answer)), "it is JSON, and finite"
    return answer


def costs_by_name(answer, key="cost"):
    rows = sorted(answer["rows"], key=lambda row: row["map"][-6:])
    return [row[key] for row in rows]


@pytest.mark.parametrize("at", TABLE_4_5)
def test_costs_are_those_of_table_4_5(at):
    assert costs_by_name(figures(known(EXPERIMENT_2), question("a", "g", at))) == pytest.approx(TABLE_4_5[at], abs=1e-3)


@pytest.mark.parametrize("theta", TABLES_4_9_TO_4_13)
def test_costs_are_those_of_tables_4_9_to_4_13(theta):
    answer = figures(known(EXPERIMENT_3), question("s", "g", theta=theta))
    assert costs_by_name(answer) == pytest.approx(TABLES_4_9_TO_4_13[theta], abs=1e-3)
    assert costs_by_name(answer, "distance") == pytest.approx([1.0, 0.694, 0.443], abs=1e-3)


@pytest.mark.parametrize("per_metre", [False, True])
@pytest.mark.parametrize("theta", [ROBUST, (0.0, 1.0, 0.0), (-1.0, 0.3, 0.2)])
def test_costs_and_plan_are_those_of_the_command_line(theta, per_metre, tmp_path, capsys):
    campus = known(EXPERIMENT_2)
    answer = figures(campus, question("a", "g", theta=theta, per_metre=per_metre))
    file = tmp_path / "campus.json"
    of_file = Environment(name="campus", model=campus.model, maps=tuple(map(map_told, campus.entries)))
    file.write_text(json.dumps(environment_json(of_file)), encoding="utf-8")
    options = ["--env", str(file), "--at", AT, "--theta", *map(str, theta), "--json"]
    options += ["--per-metre"] if per_metre else []

    def vtr(*arguments):
        capsys.readouterr()
        assert run(["env", *arguments, *options]) == 0
        return json.loads(capsys.readouterr().out)

    cost = {one["name"]: one["cost"] for one in vtr("cost")["maps"]}
    assert {row["map"]: row["cost"] for row in answer["rows"]} == pytest.approx(cost, abs=1e-6)
    plan = vtr("plan", "--from", "a", "--to", "g")
    assert (answer["plan"]["maps"], answer["plan"]["why"]) == (plan["maps"], plan["why"])
    assert answer["plan"]["cost"] == pytest.approx(plan["cost"], abs=1e-6)


def test_the_modes_choose_as_in_the_thesis():
    campus = known(EXPERIMENT_2)
    robust = figures(campus, question("a", "g"))["plan"]
    assert names(robust["maps"]) == ["map1", "map2", "map3", "map4", "map5"]
    assert robust["length"] == pytest.approx(103.24, abs=0.01)
    assert names(figures(campus, question("a", "g", theta=(0.0, 1.0, 0.0)))["plan"]["maps"]) == ["map8", "map5"]
    explored = figures(known(EXPERIMENT_3), question("s", "g", theta=(-1.0, 0.0, 0.0)))["plan"]
    assert names(explored["maps"]) == ["map3"]


def test_a_curve_is_the_cost_at_each_hour_and_is_told_once():
    campus = known(EXPERIMENT_2)
    asked = question("a", "g")
    answer = figures(campus, asked)
    hour = answer["drawn"]["hours"].index(16.0)
    at_four = {
        name: values[hour] for name, values in zip(answer["drawn"]["maps"], answer["drawn"]["values"], strict=True)
    }
    assert at_four == pytest.approx({row["map"]: row["cost"] for row in answer["rows"]}, abs=1e-4)
    assert "drawn" not in figures(campus, question("a", "g", "2023-05-08 21:15"), answer["curves"])
    for other in (question("a", "g", "2023-05-09 16:00"), question("a", "g", theta=(0.5, 0.0, 0.0))):
        assert "drawn" in figures(campus, other, answer["curves"])


def test_of_very_many_maps_the_plans_and_the_cheapest_are_listed_by_the_costs_of_all():
    rows = [(f"map{k}", "a", "b", f"2023-05-{1 + k % 28:02d} 16:{k % 60:02d}:00", 10.0 + k) for k in range(400)]
    rows.append(("map900", "b", "c", "2023-05-01 04:00:00", 4000.0))
    answer = figures(known(rows), question("a", "c", theta=(1.0, 1.0, 0.0)))
    assert len(answer["rows"]) == told.ROWS
    assert len(answer["drawn"]["maps"]) == told.CURVES
    assert answer["total"] == 401
    listed = {row["map"]: row for row in answer["rows"]}
    assert set(answer["plan"]["maps"]) <= set(listed)
    longest = listed[answer["plan"]["maps"][-1]]
    assert longest["distance"] == 1.0
    first = answer["drawn"]["maps"].index(answer["plan"]["maps"][0])
    hour = answer["drawn"]["hours"].index(16.0)
    expected = listed[answer["plan"]["maps"][0]]["cost"]
    assert answer["drawn"]["values"][first][hour] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [("g", "a", "no sequence of maps leads"), ("a", "a", "nothing to plan"), ("a", "nowhere", "no place 'nowhere'"),
     ("", "", "choose where")],
)  # fmt: skip
def test_where_there_is_no_plan_a_sentence_says_why_and_costs_are_told(start, goal, words):
    answer = figures(known(EXPERIMENT_2), question(start, goal))
    assert answer["plan"] is None
    assert words in answer["reason"]
    assert costs_by_name(answer) == pytest.approx(TABLE_4_5[AT], abs=1e-3)


def test_an_environment_without_maps_is_told():
    empty = Known("campus")
    answer = figures(empty, question("", ""))
    assert (answer["rows"], answer["plan"]) == ([], None)
    assert "no maps" in answer["reason"]
    assert told.environment_told(empty, "")["ends"] == ["", ""]


def test_robots_of_another_sensor_use_other_maps():
    both = Known("campus", 1, (*entries(EXPERIMENT_2), *entries(EXPERIMENT_3, "lidar", "r2")), model())
    assert told.environment_told(both, "")["sensors"] == ["lidar", "stereo"]
    lidar = told.environment_told(both, "lidar")
    assert {place["name"] for place in lidar["places"]} == {"s", "g"}
    assert (lidar["total"], lidar["ends"]) == (3, ["s", "g"])
    assert told.costs_told(both, "lidar", question("s", "g"), "")["total"] == 3
    assert set(lidar["robots"]) == {"r1", "r2"}


def test_the_environment_s_places_stand_apart_as_its_maps_are_long():
    campus = told.environment_told(known(EXPERIMENT_2), "")
    assert {place["label"] for place in campus["places"]} == set("abcdefg")
    at = {place["name"]: np.array(place["at"]) for place in campus["places"]}
    assert np.linalg.norm(at["e"] - at["f"]) == pytest.approx(13.3, rel=0.4)
    assert np.linalg.norm(at["a"] - at["g"]) > np.linalg.norm(at["c"] - at["d"])
    assert sum(route["maps"] for route in campus["routes"]) == len(EXPERIMENT_2)
    assert campus["model"]["rhythms"][0]["period"] == "24 h"
