"""What a browser is told of the fleet, as JSON has it. Hours count from the Unix epoch, UTC."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Any

import numpy as np

from common import messages as m
from services.console.fleet.choice import Answer, Question, answer, farthest_ends
from services.console.fleet.day import HOURS, drawn, midnight, over_day
from services.console.fleet.labels import period_text, place_name, robot_of, short_names
from services.console.fleet.robots import connected, shared
from services.console.fleet.snapshot import Known, Maps, Snapshot
from services.console.fleet.spectrum import thinned

ROWS = 300
"""Most maps that the page lists one by one."""
CURVES = 60
"""Most maps whose cost is drawn over the day."""
_DIGITS = 6
_NS_PER_HOUR = 3.6e12


def fleet_told(snapshot: Snapshot) -> dict[str, Any]:
    """The environments, and why there are none to tell of."""
    names = sorted(snapshot.maps)
    return {
        "missing": snapshot.missing,
        "environments": [
            {"name": name, "maps": snapshot.maps[name], "pending": snapshot.pending.get(name, 0)} for name in names
        ],
    }


def robots_told(snapshot: Snapshot) -> dict[str, Any]:
    """The connected robots by name."""
    return {name: asdict(robot) for name, robot in connected(snapshot.present, snapshot.states).items()}


def environment_told(known: Known, sensor: str) -> dict[str, Any]:
    """Places, where to draw them, routes, who shared what, the model and the spectrum."""
    maps = known.maps(sensor)
    start, goal = farthest_ends(maps)
    return {
        "name": known.name,
        "sensors": list(known.sensors),
        "total": len(maps.table),
        "pending": known.pending,
        "places": _places(maps),
        "routes": [{"start": a, "end": b, "maps": count} for (a, b), count in maps.routes.items()],
        "ends": [start, goal],
        "robots": {name: asdict(one) for name, one in shared(known.entries).items()},
        "model": _model(known),
        "spectrum": _spectrum(known.spectrum),
    }


def costs_told(known: Known, sensor: str, question: Question, has: str) -> dict[str, Any]:
    """Costs and plan; the curves only if the browser does not ``have`` them."""
    maps = known.maps(sensor)
    found = answer(maps, known.model, question)
    listed = drawn(found.costs, found.chosen, ROWS)
    names = short_names(maps.table.names[k] for k in listed)
    curves = listed[:CURVES]
    key = _key(known, question, [maps.table.names[k] for k in curves])
    told = {
        "at": question.at_hours,
        "rows": [_row(maps, found, k, name) for k, name in zip(listed, names, strict=True)],
        "total": len(maps.table),
        "plan": _plan(maps, found),
        "reason": found.reason,
        "curves": key,
    }
    if key != has:
        told["drawn"] = _curves(maps, known, question, curves)
    return told


def similarity_told(found: m.Similarities, start: str, end: str) -> dict[str, Any]:
    """The matrix of a route, row by row."""
    return {
        "start": start,
        "end": end,
        "maps": short_names(found.maps),
        "ids": found.maps,
        "hours": [stamp / _NS_PER_HOUR for stamp in found.stamps],
        "values": np.round(found.values, 4).tolist(),
    }


def _places(maps: Maps) -> list[dict[str, Any]]:
    """The places, and where each stands, metres; those that are not drawn without."""
    points = {name: [round(x, 3), round(y, 3)] for name, (x, y) in maps.points.items()}
    return [{"name": name, "label": place_name(name), "at": points.get(name)} for name in maps.table.places]


def _model(known: Known) -> dict[str, Any]:
    told = known.told
    if told is None:
        return {"reason": "the server has published no model yet", "maps": 0, "revision": 0, "rhythms": [], "trend": 0}
    columns = (told.periods_hours, told.weights, told.phases, told.significance)
    keys = ("period_hours", "weight", "phase", "significance")
    rhythms = [dict(zip(keys, values, strict=True)) for values in zip(*columns, strict=True)]
    return {
        "reason": told.reason,
        "maps": told.maps,
        "revision": told.revision,
        "trend": told.trend_per_hour,
        "rhythms": [{**one, "period": period_text(one["period_hours"])} for one in rhythms],
    }


def _spectrum(spectrum: m.EnvironmentSpectrum | None) -> dict[str, Any] | None:
    if spectrum is None or not len(spectrum.frequencies):
        return None
    periods, power = thinned(spectrum)
    return {
        "periods": np.round(periods, 5).tolist(),
        "power": np.round(power, 5).tolist(),
        "levels": [list(level) for level in spectrum.levels],
    }


def _row(maps: Maps, found: Answer, k: int, name: str) -> dict[str, Any]:
    table, costs = maps.table, found.costs
    terms = {"similarity": costs.similarity, "distance": costs.distance, "drift": costs.drift}
    more = {} if table.trouble is None else {"trouble": costs.trouble}
    figures = {**terms, **more, "cost": costs.cost, "edge": costs.edge}
    return {
        "map": table.names[k],
        "name": name,
        "robot": robot_of(table.names[k]),
        "start": table.places[int(table.start[k])],
        "end": table.places[int(table.end[k])],
        "from": place_name(table.places[int(table.start[k])]),
        "to": place_name(table.places[int(table.end[k])]),
        "length": round(float(table.length[k]), 3),
        "hours": float(table.hours[k]),
        "generation": int(table.generation[k]),
        **{key: round(float(values[k]), _DIGITS) for key, values in figures.items()},
    }


def _plan(maps: Maps, found: Answer) -> dict[str, Any] | None:
    made = found.plan
    if made is None:
        return None
    length = float(maps.table.length[made.edges].sum())
    return {"maps": made.maps, "cost": round(made.cost, _DIGITS), "length": round(length, 3), "why": made.why}


def _curves(maps: Maps, known: Known, question: Question, shown: list[int]) -> dict[str, Any]:
    begin, names = midnight(question.at_hours), [maps.table.names[k] for k in shown]
    costs = over_day(maps.table, known.model, begin, question.theta, shown, per_metre=question.per_metre)
    return {"begin": begin, "hours": HOURS.tolist(), "maps": names, "values": np.round(costs.T, 4).tolist()}


def _key(known: Known, question: Question, names: list[str]) -> str:
    """Stands for the curves: equal only where they are."""
    what = (known.version, midnight(question.at_hours), question.theta, question.per_metre, sorted(names))
    return hashlib.sha256(repr(what).encode()).hexdigest()[:16]
