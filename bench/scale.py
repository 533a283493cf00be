"""How each cost grows with the number of maps, from a robot's few to a fleet's millions, with slopes and a picture.

One thread; times are the processor's, memory is that of the arrays and objects that are kept. ``docs/scale.md`` says
what the slopes mean. The picture goes to ``docs/images/scale.png``.
"""

from __future__ import annotations

import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.environment import MODEL, NOW, environment
from bench.table import show
from common.environment import Network, Theta, map_costs, plan
from common.environment.metadata import Archive, ImageAlong, MapMetadata, time_of
from common.ids import new_map_id
from common.registration import OF_THUMBNAILS, Described, GradientRepresentation
from services.fleet.catalog import Catalog, Columns, SharedMap
from services.fleet.rows import Images, row
from services.fleet.spectrum import of_maps

Array = NDArray[np.float64]
Series = dict[int, float]

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "scale.png"
_ALONG = 4
_HOUR_NS = 3_600_000_000_000


def main() -> None:
    """Measures, prints, draws."""
    series = {
        "costs of all maps, ms": _measure((1_000, 10_000, 100_000, 1_000_000, 10_000_000), _costs),
        "plan, graph at hand, ms": _measure((1_000, 10_000, 100_000, 1_000_000), _plan),
        "graph of the columns, ms": _measure((1_000, 10_000, 100_000, 1_000_000), _graph),
        "a row of similarities, ms": _measure((100, 500, 1_000, 2_000), _row),
        "the spectral model, ms": _measure((100, 300, 1_000, 2_000), _model),
        "first plan after a new map, ms": _measure((1_000, 10_000, 100_000), _first_plan),
    }
    rows = [[name, *_row_of(values)] for name, values in series.items()]
    columns = ["what", "maps", "time", "maps", "time", "slope"]
    show("how times grow: each at the least and the most maps, and the exponent between the last two", columns, rows)
    _sizes()
    _draw(series)


def _measure(counts: tuple[int, ...], prepare: Callable[[int], Callable[[], object]]) -> Series:
    """Milliseconds by number of maps, the best of a few runs; the first run compiles."""
    found = {}
    for count in counts:
        run = prepare(count)
        run()
        found[count] = min(_timed(run) for _ in range(3))
    return found


def _timed(run: Callable[[], object]) -> float:
    begin = process_time()
    run()
    return 1e3 * (process_time() - begin)


def _costs(count: int) -> Callable[[], object]:
    maps = environment(count)
    return lambda: map_costs(maps, MODEL, NOW, Theta(1.0, 0.5, 0.1))


def _graph(count: int) -> Callable[[], object]:
    maps = environment(count)
    return lambda: Network.of(maps)


def _plan(count: int) -> Callable[[], object]:
    maps = environment(count)
    network = Network.of(maps)
    goal = f"place{len(maps.places) // 2}"
    return lambda: plan(maps, network, MODEL, "place0", goal, NOW, Theta(1.0, 0.5, 0.1))


def _row(count: int) -> Callable[[], object]:
    random = np.random.default_rng(0)
    pictures = [_described(random) for _ in range(32)]
    stored = np.stack([picture.to_arrays()["values"] for picture in pictures])
    along = (np.arange(count)[:, None] + np.arange(_ALONG)) % len(pictures)
    maps = Images(stored[along], np.full(count, _ALONG))
    return lambda: row(maps.values[0], maps, pictures[0].cell_height)


def _described(random: np.random.Generator) -> Described:
    image = random.integers(0, 256, (25, 40), dtype=np.uint8).repeat(5, 0).repeat(5, 1)
    return GradientRepresentation(OF_THUMBNAILS).describe(image)


def _model(count: int) -> Callable[[], object]:
    random = np.random.default_rng(0)
    hours = np.sort(random.uniform(0, 24 * 60, count))
    values = 0.5 * np.cos(2 * np.pi * (hours[:, None] - hours) / 24) + 0.2 * random.normal(size=(count, count))
    matrix = (values + values.T) / 2
    return lambda: of_maps(hours, matrix)


def _metadata(count: int) -> list[MapMetadata]:
    """Maps as a server reads them, without pictures: what a catalog keeps does not depend on these."""
    random = np.random.default_rng(0)
    archive = Archive(bytes=10**7, sha256="0" * 64)
    places = max(2, count // 20)
    found = []
    for k in range(count):
        stamp = round((NOW - 20_000 * float(random.random())) * _HOUR_NS)
        start = int(random.integers(0, places))
        found.append(
            MapMetadata(
                name=new_map_id("r1", stamp + k),
                environment="park",
                robot="r1",
                sensor="stereo",
                timestamp=time_of(stamp),
                length=50.0,
                start=f"place{start}",
                end=f"place{(start + int(random.integers(1, 40))) % places}",
                vertices=1,
                times=[0.0],
                distances=[0.0],
                archive=archive,
            )
        )
    return found


def _first_plan(count: int) -> Callable[[], object]:
    """What a new map costs the next plan: its row of the columns, and the graph sorted anew."""
    known = [SharedMap.of(metadata, 0) for metadata in _metadata(count + 10)]
    columns = Columns(known[:count])
    columns.view()
    more = iter(known[count:])

    def run() -> object:
        columns.add(next(more))
        return columns.view()

    return run


def _sizes() -> None:
    """What is stored and kept of a map."""
    random = np.random.default_rng(0)
    images = [ImageAlong.of(float(k), _described(random)) for k in range(_ALONG)]
    vertices = 125
    metadata = _metadata(1)[0].model_copy(
        update={
            "vertices": vertices,
            "times": [0.4 * k for k in range(vertices)],
            "distances": [0.4 * k for k in range(vertices)],
            "actions": [(0.4 * k, 0.4 * k, 1.0, 0.1) for k in range(vertices)],
            "images": images,
        }
    )
    known = _metadata(20_000)
    tracemalloc.start()
    catalog = Catalog(SharedMap.of(one, 0) for one in known)
    entries, _ = tracemalloc.get_traced_memory()
    catalog.columns("stereo").view()
    built, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    pictures = sum(len(image.values) for image in images)
    rows: list[list[object]] = [
        ["metadata in the storage, 50 m at a vertex each 0.4 m, kB", len(metadata.model_dump_json()) / 1e3],
        ["of these, four pictures, kB", sum(len(image.model_dump_json()) for image in images) / 1e3],
        ["catalog of the server with its columns, kB a map", entries / len(known) / 1e3],
        ["its graph, kB a map", (built - entries) / len(known) / 1e3],
        ["pictures of a compared map, kB", pictures / 1e3],
        ["similarities, of the 2,000 newest, MB", 2_000**2 * 8 / 1e6],
    ]
    show("how much is kept", ["what", "size"], rows)


def _row_of(values: Series) -> list[object]:
    counts = sorted(values)
    first, before, last = counts[0], counts[-2], counts[-1]
    slope = float(np.log(values[last] / values[before]) / np.log(last / before))
    return [first, values[first], last, values[last], slope]


def _draw(series: dict[str, Series]) -> None:
    figure = Figure(figsize=(9, 5.6), dpi=120, layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    for name, values in series.items():
        counts = sorted(values)
        axes.loglog(counts, [values[count] for count in counts], marker="o", label=name)
    axes.axhline(100.0, color="0.6", linewidth=0.8, linestyle="--")
    axes.annotate("100 ms", (4e6, 110.0), color="0.4", fontsize=9)
    axes.set_xlabel("maps of an environment")
    axes.set_ylabel("milliseconds of one core")
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False, fontsize=9)
    axes.set_title("What grows with the number of maps", loc="left", fontsize=12, fontweight="bold")
    path = PICTURE if PICTURE.parent.is_dir() else Path(tempfile.gettempdir()) / PICTURE.name
    figure.savefig(path)
