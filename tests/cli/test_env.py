"""``vtr env``: its JSON as the issue has it, its pictures, and a sentence for whatever is wrong."""

import csv
import json

import cv2
import numpy as np
import pytest

from tests.common.environment.thesis import EXPERIMENT_2, EXPERIMENT_3, environment
from tests.services.fleet.series import likeness_of, mixture

AT = ("--at", "2023-05-08 16:00:00")
PNG = b"\x89PNG"


@pytest.fixture
def campus(tmp_path):
    path = tmp_path / "campus.json"
    path.write_text(json.dumps(environment(EXPERIMENT_2)), encoding="utf-8")
    return path


def series(path, hours, values, header=()):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([*header, *zip(3600 * hours, values, strict=True)])
    return path


def test_cost_prints_every_map_in_the_file_s_order(vtr, campus, tmp_path):
    result = vtr("env", "cost", "--env", campus, *AT, "--theta", 1, 0, 0, "--json", "--plot", tmp_path / "c.png")
    data = json.loads(result.out)
    assert data["at"] == "2023-05-08T16:00:00+00:00"
    assert [entry["name"] for entry in data["maps"]] == [row[0] for row in EXPERIMENT_2]
    assert set(data["maps"][0]) == {"name", "similarity_cost", "distance_cost", "drift_cost", "cost"}
    assert data["maps"][0]["cost"] == pytest.approx(0.022, abs=1e-3)
    assert (tmp_path / "c.png").read_bytes().startswith(PNG)
    assert "map9" in vtr("env", "cost", "--env", campus).out


def test_plan_prints_maps_cost_and_why(vtr, campus, tmp_path):
    ends = ("--from", "A", "--to", "G")
    result = vtr("env", "plan", "--env", campus, *ends, *AT, "--json", "--plot", tmp_path / "p.png")
    data = json.loads(result.out)
    assert data["maps"] == ["map1", "map2", "map3", "map4", "map5"]
    assert data["cost"] == pytest.approx(0.147, abs=1e-3)
    assert len(data["why"]) == 6
    assert (tmp_path / "p.png").read_bytes().startswith(PNG)
    assert "map8 map5" in vtr("env", "plan", "--env", campus, *ends, *AT, "--mode", "shortest").out


def test_theta_takes_negative_weights_and_per_metre_is_passed_on(vtr, tmp_path):
    path = tmp_path / "e3.json"
    path.write_text(json.dumps(environment(EXPERIMENT_3)), encoding="utf-8")
    ends = ("--from", "S", "--to", "G", *AT, "--json")
    explored = json.loads(vtr("env", "plan", "--env", path, *ends, "--theta", "-1", "0", "0").out)
    assert explored["maps"] == ["map3"]
    assert explored == json.loads(vtr("env", "plan", "--env", path, *ends, "--mode", "explore").out)
    costs = [
        [entry["cost"] for entry in json.loads(vtr("env", "cost", "--env", path, *AT, "--json", *more).out)["maps"]]
        for more in ((), ("--per-metre",))
    ]
    assert costs[1] == pytest.approx(np.multiply(costs[0], [1.0, 0.694, 0.443]), rel=1e-2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("cost", "--env", "nowhere.json"), ["nowhere.json"]),
        (("cost", "--env", "campus.json", "--at", "noon"), ["--at", "noon"]),
        (("cost", "--env", "campus.json", "--theta", "nan", "0", "0"), ["--theta", "finite"]),
        (("cost", "--env", "campus.json", "--mode", "fast"), ["--mode", "robust, shortest, explore"]),
        (("cost", "--env", "campus.json", "--mode", "robust", "--theta", 1, 0, 0), ["not both"]),
        (("cost", "--env", "campus.json", "--plot", "no/where.png"), ["no folder"]),
        (("plan", "--env", "campus.json", "--from", "A", "--to", "Z"), ["no place 'Z'"]),
        (("plan", "--env", "campus.json", "--from", "G", "--to", "A"), ["no sequence"]),
        (("spectrum",), ["--series", "--similarity"]),
        (("spectrum", "--series", "nowhere.csv"), ["nowhere.csv"]),
        (("spectrum", "--similarity", "campus.json"), ["timestamps and matrix"]),
        (("similarity", "nowhere"), ["nowhere"]),
    ],
)
@pytest.mark.usefixtures("campus")
def test_what_is_wrong_is_said_in_one_sentence(vtr, arguments, words):
    result = vtr("env", *arguments)
    assert result.code == 1
    assert all(word in result.sentence for word in words)


def test_spectrum_of_a_series(vtr, tmp_path):
    hours, values, _ = mixture(np.random.default_rng(0), 300, 60, [24.0, 168.0], 0.3)
    path = series(tmp_path / "s.csv", hours + 470_000, values, header=[("time", "value")])
    result = vtr("env", "spectrum", "--series", path, "--json", "--plot", tmp_path / "s.png")
    data = json.loads(result.out)
    assert {"periods_hours", "weights", "phases", "significance", "reason"} <= set(data)
    assert sorted(data["periods_hours"]) == pytest.approx([24, 168], rel=0.02)
    assert data["weights"] == sorted(data["weights"], reverse=True)
    assert (tmp_path / "s.png").read_bytes().startswith(PNG)
    assert "168 h" in vtr("env", "spectrum", "--series", path).out


def test_spectrum_of_a_similarity_matrix_is_a_model_that_cost_can_use(vtr, tmp_path):
    rng = np.random.default_rng(0)
    hours = np.sort(rng.uniform(470_000, 470_300, 40))
    content = {"timestamps": (3600 * hours).tolist(), "matrix": likeness_of(rng, hours, [24.0], 0.3).tolist()}
    path = tmp_path / "sim.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    data = json.loads(vtr("env", "spectrum", "--similarity", path, "--json", "--plot", tmp_path / "s.png").out)
    assert data["periods_hours"][0] == pytest.approx(24, rel=0.02)
    model = {key: data[key] for key in ("periods_hours", "weights", "phases", "trend_per_hour")}
    (tmp_path / "env.json").write_text(json.dumps(environment(EXPERIMENT_2, model)), encoding="utf-8")
    assert vtr("env", "cost", "--env", tmp_path / "env.json").code == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2\n3,x\n", ["line 2", "3,x"]),
        ("1,2\n3\n", ["line 2"]),
        ("1,2\n3,inf\n", ["line 2"]),
        ("\x00\xff", ["no csv"]),
    ],
)
def test_a_bad_series_is_refused_with_its_line(vtr, tmp_path, text, words):
    path = tmp_path / "s.csv"
    path.write_bytes(text.encode("latin-1"))
    result = vtr("env", "spectrum", "--series", path)
    assert all(word in result.sentence for word in words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"timestamps": [1, 2], "matrix": [[1, 2]]}, ["1x2", "2 timestamps"]),
        ({"timestamps": [1, 2], "matrix": [[1, 2], [3]]}, ["square of numbers"]),
        ({"timestamps": ["x"], "matrix": [[1]]}, ["'x' is no time"]),
        ({"timestamps": 3, "matrix": []}, ["must be a list"]),
        ({"timestamps": [1], "matrix": [[float("nan")]]}, ["not finite"]),
        ({"timestamps": [1], "matrix": [[1]], "names": []}, ["names"]),
        ([], ["timestamps and matrix"]),
    ],
)
def test_a_bad_matrix_is_refused(vtr, tmp_path, content, words):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    result = vtr("env", "spectrum", "--similarity", path)
    assert result.code == 1
    assert all(word in result.sentence for word in words)


@pytest.mark.parametrize("content", ["", "time,value\n", "1,2\n2,3\n"])
def test_too_short_a_series_is_no_error_but_an_answer(vtr, tmp_path, content):
    (tmp_path / "s.csv").write_text(content, encoding="utf-8")
    result = vtr("env", "spectrum", "--series", tmp_path / "s.csv", "--json", "--plot", tmp_path / "s.png")
    assert result.code == 0
    assert json.loads(result.out)["reason"].startswith("not enough data")


def test_similarity_compares_only_the_maps_that_are_new(vtr, tmp_path):
    rng = np.random.default_rng(0)
    folder = tmp_path / "maps"
    for hour in (8, 9, 10):
        place = folder / f"2023-06-13T{hour:02d}_00_00"
        place.mkdir(parents=True)
        for k in range(3):
            cv2.imwrite(str(place / f"{k:03d}.png"), rng.integers(0, 255, (48, 96), np.uint8))
    whole = json.loads(vtr("env", "similarity", folder, "--json", "-o", tmp_path / "all.json").out)
    assert np.allclose(np.diag(whole["matrix"]), 1.0, atol=0.01)
    assert np.diff(whole["timestamps"]).tolist() == [3600, 3600]
    first = {"names": whole["names"][:2], "timestamps": whole["timestamps"][:2], "matrix": [[7.0, 7.0], [7.0, 7.0]]}
    (tmp_path / "first.json").write_text(json.dumps(first), encoding="utf-8")
    grown = json.loads(vtr("env", "similarity", folder, "--add-to", tmp_path / "first.json", "--json").out)
    assert np.array(grown["matrix"])[:2, :2].tolist() == first["matrix"]
    assert grown["matrix"][2] == pytest.approx(whole["matrix"][2], abs=1e-5)
    soft = json.loads(vtr("env", "similarity", folder, "--softmax", 3, "--json").out)
    assert np.sum(soft["matrix"], axis=1) == pytest.approx([1, 1, 1], abs=1e-5)


def test_maps_without_a_time_or_without_images_are_named(vtr, tmp_path):
    (tmp_path / "maps" / "shed").mkdir(parents=True)
    assert "shed" in vtr("env", "similarity", tmp_path / "maps").sentence
    cv2.imwrite(str(tmp_path / "maps" / "shed" / "0.png"), np.zeros((40, 40), np.uint8))
    assert "no time in its name" in vtr("env", "similarity", tmp_path / "maps").sentence
