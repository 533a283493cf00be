"""Latency of a commit to the map store, by the size of its keyframe, beside a plain file's write and fsync.

The two take turns on the same disk. The store also moves its log to its main file meanwhile, from another thread, as
the service does.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from bench.table import show
from common import geometry
from common.ids import VertexId, new_map_id
from common.messages import Commit, EdgeRecord, Keyframe, MapRecord, VertexRecord, covariance_of, now_ns
from services.mapstore.store import Store

SIZES_KB = (1, 50, 150, 500, 1500)
COUNT = 100
VERTEX_PERIOD_S = 0.01
"""Fifty times as often as a robot makes vertices."""


def commits(record: MapRecord, count: int, size: int) -> list[Commit]:
    """A drive's commits, each with a keyframe of ``size`` bytes."""
    rng = np.random.default_rng(0)
    out = []
    for index in range(count):
        keyframe = Keyframe(pipeline="stereo", arrays={"content": rng.integers(0, 256, size, dtype=np.uint8)})
        vertex = VertexRecord(id=VertexId(record.id, index), stamp=now_ns(), keyframe=keyframe)
        edges = []
        if index:
            T_a_b = geometry.from_xy_yaw(0.3, 0, 0)
            a = VertexId(record.id, index - 1)
            edges.append(
                EdgeRecord(kind="temporal", a=a, b=vertex.id, T_a_b=T_a_b, covariance=covariance_of([1e-4] * 6))
            )
        out.append(Commit(map=record, vertex=vertex, edges=edges))
    return out


def write_file(path: Path, content: bytes) -> None:
    """A file that is on the disk when this returns."""
    handle = os.open(path, os.O_CREAT | os.O_WRONLY)
    os.write(handle, content)
    os.fsync(handle)
    os.close(handle)


def measure(folder: Path, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Durations (ms) of ``count`` commits and of as many files, in turns."""
    store, stop = Store(folder / "store" / "maps.sqlite"), threading.Event()

    def tidy() -> None:
        while not stop.wait(0.05):
            store.checkpoint()

    tidier = threading.Thread(target=tidy)
    tidier.start()
    record = MapRecord(id=new_map_id("r1", now_ns()), environment="bench", stamp=0, robot="r1", sensor="front")
    durations: tuple[list[float], list[float]] = ([], [])
    for index, commit in enumerate(commits(record, count, size)):
        content = os.urandom(size)
        jobs = (lambda c=commit: store.commit(c), lambda i=index, c=content: write_file(folder / str(i), c))
        for job, results in zip(jobs, durations, strict=True):
            start = time.perf_counter()
            job()
            results.append((time.perf_counter() - start) * 1e3)
        time.sleep(VERTEX_PERIOD_S)
    stop.set()
    tidier.join()
    store.close()
    return np.array(durations[0]), np.array(durations[1])


def main() -> None:
    """Prints the table."""
    rows = []
    for size_kb in SIZES_KB:
        with tempfile.TemporaryDirectory() as folder:
            store, file = measure(Path(folder), COUNT, size_kb * 1000)
        (s50, s99), (f50, f99) = np.percentile(store, [50, 99]), np.percentile(file, [50, 99])
        rows.append([f"{size_kb} kB", s50, s99, f50, f99, s50 / f50])
    show(
        "Committing a vertex, ms until it is durable",
        ["blob", "commit p50", "p99", "file and fsync p50", "p99", "ratio of p50"],
        rows,
    )


if __name__ == "__main__":
    main()
