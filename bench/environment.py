"""The model of an environment: cost and plan as maps grow, and rhythms from known mixtures, each beside its peer.

Plans are compared with networkx's A* on the same graph with the same costs and heuristic, costs with plain numpy,
periods with the peaks of the raw non-uniform FFT (the thesis's way), the periodogram's time with scipy's. One thread;
times are the processor's.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from time import process_time
from typing import Any

import finufft
import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from bench.table import show
from common.environment import MapTable, Model, Network, Theta, map_costs, plan
from services.fleet.periodogram import Grid, Periodogram
from services.fleet.spectrum import of_series

Array = NDArray[np.float64]

NOW = 470_000.0
MODEL = Model(periods_hours=[24, 168, 8766], weights=[1, 0.5, 0.5], phases=[0, 0.1, 0.2], trend_per_hour=1e-5)
PERIODS = (12.0, 24.0, 168.0, 37.3)
"""Hours; the last lies on no grid."""

_GRID = Grid(1e-3, 1e-4, 2048)
_MAPS_PER_PLACE = 20
_SERIES = 10
_NOISE_SERIES = 100


def environment(count: int, seed: int = 0) -> MapTable:
    """Random maps between a twentieth as many places, each leading to a place that is not far in number."""
    random = np.random.default_rng(seed)
    places = max(2, count // _MAPS_PER_PLACE)
    start = random.integers(0, places, count)
    end = (start + random.integers(1, 40, count)) % places
    return MapTable(
        names=[f"map{k}" for k in range(count)],
        places=[f"place{k}" for k in range(places)],
        start=start.astype(np.int32),
        end=end.astype(np.int32),
        hours=random.uniform(NOW - 20_000, NOW, count),
        length=random.uniform(10, 200, count),
        generation=random.integers(0, 5, count),
    )


def plans() -> None:
    """Times of a plan across the environment, beside networkx."""
    rows: list[list[object]] = []
    for count in (1_000, 10_000, 100_000):
        maps = environment(count)
        building, network = timed(lambda maps=maps: Network.of(maps))
        goal = len(maps.places) // 2
        ms, made = timed(
            lambda maps=maps, network=network, goal=goal: plan(
                maps, network, MODEL, "place0", f"place{goal}", NOW, Theta(1.0, 0.5, 0.1)
            )
        )
        graph = nx.MultiDiGraph()
        edges = zip(maps.start.tolist(), maps.end.tolist(), made.costs.edge.tolist(), strict=True)
        graph.add_weighted_edges_from(edges)
        hops, least = network.hops(goal), float(made.costs.edge.min())
        peer, path = timed(
            lambda graph=graph, goal=goal, hops=hops, least=least: nx.astar_path(
                graph, 0, goal, heuristic=lambda place, _: float(hops[place]) * least
            ),
            repeats=1,
        )
        total = sum(min(e["weight"] for e in graph[a][b].values()) for a, b in itertools.pairwise(path))
        assert abs(total - made.cost) < 1e-9
        size = sum(getattr(network, name).nbytes for name in network.__slots__)
        rows.append([count, len(maps.places), len(made.maps), ms, building, peer, peer / ms, size / 1e6])
    columns = ["maps", "places", "maps of the plan", "plan, ms", "graph, ms", "networkx A*, ms", "ratio", "graph, MB"]
    show("plan, costs of all maps and reasons included", columns, rows, "the graph is built once, not for each plan")


def costs() -> None:
    """Times of the costs of all maps, beside numpy's own cosine."""
    rows: list[list[object]] = []
    for count in (10_000, 100_000, 1_000_000):
        maps = environment(count)
        ms, ours = timed(lambda maps=maps: map_costs(maps, MODEL, NOW, Theta(1.0, 0.5, 0.1)))
        peer, theirs = timed(lambda maps=maps: _plain_costs(maps))
        assert np.abs(ours.cost - theirs).max() < 1e-9
        columns = (maps.start, maps.end, maps.hours, maps.length, maps.generation)
        rows.append([count, ms, peer, peer / ms, sum(column.nbytes for column in columns) / 1e6])
    columns = ["maps", "ms", "plain numpy, ms", "ratio", "columns, MB"]
    show("cost of all maps at a time, three periods and a trend", columns, rows)


def _plain_costs(maps: MapTable) -> Array:
    lag = NOW - maps.hours
    waves = zip(MODEL.periods_hours, MODEL.weights, MODEL.phases, strict=True)
    cyclic = 0.5 - sum(w * np.cos(2 * np.pi * lag / T - phi) for T, w, phi in waves) / 6
    similarity = cyclic + 1 - np.exp(-MODEL.trend_per_hour * np.maximum(lag, 0))
    total: Array = similarity + 0.5 * maps.length / maps.length.max() + 0.1 * (1 - np.exp(-maps.generation / 10))
    return total


def mixtures() -> None:
    """How often all periods of a mixture are found, beside the peaks of the raw transform."""
    cases = ((24, 28, 2, 0.2), (24, 28, 3, 0.1), (40, 28, 4, 0.2), (100, 60, 4, 0.5), (1_000, 180, 4, 1.0))
    rows: list[list[object]] = []
    for count, days, number, noise in (*cases, (10_000, 365, 4, 1.0)):
        periods = PERIODS[-number:] if number < 3 else PERIODS[:number]
        ours, raw, others, phases, spent = 0, 0, 0, [], 0.0
        for seed in range(_SERIES):
            hours, values, truth = mixture(np.random.default_rng(seed), count, days, periods, noise)
            begin = process_time()
            found = of_series(hours, values)
            spent += process_time() - begin
            ours += _all_found(periods, found.periods_hours)
            raw += _all_found(periods, raw_peaks(hours, values, number))
            others += sum(min(abs(T / p - 1) for T in periods) > 0.02 for p in found.periods_hours) > 0
            phases += _phase_errors(periods, truth, found.periods_hours, found.phases, float(hours.mean()))
        within = 100 * float((np.array(phases) < 10).mean()) if phases else 0.0
        part = [100 * k / _SERIES for k in (ours, raw, others)]
        rows.append([count, days, ", ".join(f"{T:g}" for T in periods), noise, *part, within, 1e3 * spent / _SERIES])
    columns = [
        "samples",
        "days",
        "periods, h",
        "noise",
        "all found, %",
        "raw peaks, %",
        "others, %",
        "phase < 10°, %",
        "ms",
    ]
    show(f"mixtures of equal amplitude 1, {_SERIES} series a row: all periods within 2 %", columns, rows)


def noises() -> None:
    """How often a rhythm is claimed in noise."""
    rows: list[list[object]] = []
    for count, days in ((24, 28), (100, 60), (150, 60), (1_000, 180), (10_000, 365)):
        claims, spent = 0, process_time()
        for seed in range(_NOISE_SERIES):
            random = np.random.default_rng(seed)
            claims += len(of_series(random.uniform(0, 24 * days, count), random.normal(size=count)).periods_hours) > 0
        rows.append([count, days, claims, 1e3 * (process_time() - spent) / _NOISE_SERIES])
    show(f"pure noise, {_NOISE_SERIES} series a row, 1 % level", ["samples", "days", "with a period", "ms"], rows)


def periodograms() -> None:
    """Times of the periodogram, beside scipy's."""
    rows: list[list[object]] = []
    for count in (100, 1_000, 10_000):
        hours, values, _ = mixture(np.random.default_rng(0), count, 60, PERIODS, 1.0)
        hours, shares = hours - hours.mean(), np.full(count, 1 / count)
        ms, ours = timed(
            lambda hours=hours, values=values, shares=shares: Periodogram(hours, shares, _GRID).power(values)
        )
        peer, theirs = timed(
            lambda hours=hours, values=values: signal.lombscargle(
                hours, values - values.mean(), 2 * np.pi * _GRID.frequencies, floating_mean=True, normalize=True
            ),
            repeats=1,
        )
        assert np.abs(ours - theirs).max() < 1e-5
        rows.append([count, ms, peer, peer / ms])
    show("floating-mean periodogram, 2048 frequencies", ["samples", "ms", "scipy, ms", "ratio"], rows)


def mixture(
    random: np.random.Generator, count: int, days: float, periods: Sequence[float], noise: float
) -> tuple[Array, Array, Array]:
    """Irregular times (N,), hours; values; and the phases of the rhythms in them."""
    hours = np.sort(random.uniform(0, 24 * days, count))
    phases = random.uniform(-np.pi, np.pi, len(periods))
    waves = [np.cos(2 * np.pi * hours / T - p) for T, p in zip(periods, phases, strict=True)]
    return hours, np.sum(waves, axis=0) + noise * random.normal(size=count), phases


def raw_peaks(hours: Array, values: Array, number: int) -> Array:
    """The periods of the highest local maxima of the magnitude of the non-uniform Fourier transform."""
    span = float(np.ptp(hours))
    frequencies = np.arange(1.5 / span, 1 / 3, 1 / (6 * span))
    strengths = (values - values.mean()).astype(np.complex128)
    size = np.abs(finufft.nufft1d3(2 * np.pi * hours, strengths, frequencies, eps=1e-9, nthreads=1))
    inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1
    return 1 / frequencies[inner[np.argsort(-size[inner])[:number]]]


def _all_found(periods: Sequence[float], found: Array) -> bool:
    return all(np.abs(found / period - 1).min(initial=np.inf) < 0.02 for period in periods)


def _phase_errors(periods: Sequence[float], truth: Array, found: Array, phases: Array, middle: float) -> list[float]:
    """Degrees between found and true rhythms in the middle of the series, where a period's error does not count."""
    errors = []
    for period, phase in zip(periods, truth, strict=True):
        near = np.flatnonzero(np.abs(found / period - 1) < 0.02)
        if len(near):
            turn = 2 * np.pi * middle * (1 / found[near[0]] - 1 / period) - phases[near[0]] + phase
            errors.append(abs(float(np.degrees(np.angle(np.exp(1j * turn))))))
    return errors


def timed(work: Callable[[], Any], repeats: int = 5) -> tuple[float, Any]:
    """Milliseconds of the processor, the least of some repeats after one that compiles, and the result."""
    result = work()
    least = np.inf
    for _ in range(repeats):
        begin = process_time()
        result = work()
        least = min(least, process_time() - begin)
    return 1e3 * least, result


def main() -> None:
    """Prints all tables."""
    plans()
    costs()
    periodograms()
    mixtures()
    noises()


if __name__ == "__main__":
    main()
