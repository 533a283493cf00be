"""The directed multigraph of places and maps, and A* in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.environment.table import MapTable

Array = NDArray[np.float64]
Ids = NDArray[np.int32]

_NONE = -1


@dataclass(frozen=True, slots=True)
class Network:
    """The edges (N) of a graph of P places, sorted by either end once, for any number of searches.

    Attributes:
        start, end: (N,) the places that each edge leads from and to.
        out_first, in_first: (P + 1,) where a place's edges begin in the next two.
        out_edges, in_edges: (N,) edges by the place that they leave, and by the one that they reach.
    """

    start: Ids
    end: Ids
    out_first: Ids
    out_edges: Ids
    in_first: Ids
    in_edges: Ids

    @classmethod
    def of(cls, maps: MapTable) -> Self:
        """The graph whose edges are maps."""
        places = len(maps.places)
        return cls(maps.start, maps.end, *_sorted(maps.start, places), *_sorted(maps.end, places))

    def hops(self, goal: int) -> Ids:
        """(P,) the least number of edges from each place to the goal, -1 where no way leads there."""
        return _levels(self.in_first, self.in_edges, self.start, goal)

    def reachable(self, start: int) -> NDArray[np.bool_]:
        """(P,) which places a way leads to."""
        within: NDArray[np.bool_] = _levels(self.out_first, self.out_edges, self.end, start) != _NONE
        return within

    def parallel(self, edge: int) -> Ids:
        """All edges with the same two ends as an edge, itself among them, in their order."""
        edges = self.out_edges[self.out_first[self.start[edge]] : self.out_first[self.start[edge] + 1]]
        parallel: Ids = edges[self.end[edges] == self.end[edge]]
        return parallel

    def cheapest(self, cost: Array, start: int, goal: int) -> list[int]:
        """The edges of the path of least cost, by A*; of equal ones a path with the fewest edges.

        ``cost`` (N,) is nowhere negative. The heuristic is the least number of edges that are still to come, times the
        cheapest edge's cost: it never exceeds the truth, nor falls by more than an edge's cost along it, so that the
        first time a place is reached for good is the best. Edges of infinite cost are closed. Empty where no way leads
        to the goal, or it is the start.
        """
        hops = self.hops(goal)
        if hops[start] <= 0:
            return []
        least = float(cost.min())
        heuristic: Array = (least if np.isfinite(least) else 0.0) * hops.astype(np.float64)
        arrived_by = _a_star(self.out_first, self.out_edges, self.end, cost, heuristic, hops, start, goal)
        if arrived_by[goal] == _NONE:
            return []
        edges: list[int] = []
        place = goal
        while place != start:
            edges.append(int(arrived_by[place]))
            place = int(self.start[edges[-1]])
        return edges[::-1]


def _sorted(ends: Ids, places: int) -> tuple[Ids, Ids]:
    """Where each place's edges begin (P + 1,), and the edges (N,) sorted by place, else in their order."""
    first = np.zeros(places + 1, dtype=np.int32)
    np.cumsum(np.bincount(ends, minlength=places), out=first[1:])
    return first, np.argsort(ends, kind="stable").astype(np.int32)


@kernel
def _levels(first: Ids, edges: Ids, other: Ids, root: int) -> Ids:
    """Breadth first from ``root``: (P,) the number of edges to each place, -1 where it is out of reach."""
    level = np.full(len(first) - 1, _NONE, np.int32)
    queue = np.empty(len(first) - 1, np.int32)
    queue[0] = root
    level[root] = 0
    taken, waiting = 0, 1
    while taken < waiting:
        place = queue[taken]
        taken += 1
        for k in range(first[place], first[place + 1]):
            neighbour = other[edges[k]]
            if level[neighbour] == _NONE:
                level[neighbour] = level[place] + 1
                queue[waiting] = neighbour
                waiting += 1
    return level


@kernel
def _a_star(first: Ids, edges: Ids, end: Ids, cost: Array, heuristic: Array, hops: Ids, start: int, goal: int) -> Ids:
    """(P,) the edge by which the best path reaches each place that was looked at; the goal can be reached."""
    places = len(first) - 1
    best = np.full(places, np.inf)
    count = np.zeros(places, np.int32)
    arrived_by = np.full(places, _NONE, np.int32)
    heap = np.empty(len(edges) + 1, np.int32)
    heap_cost, heap_count = np.empty(len(edges) + 1), np.empty(len(edges) + 1, np.int32)
    best[start] = 0.0
    heap[0], heap_cost[0], heap_count[0] = start, heuristic[start], 0
    size = 1
    while size > 0:
        place, estimate, edges_so_far = heap[0], heap_cost[0], heap_count[0]
        size -= 1
        _sift_down(heap, heap_cost, heap_count, size)
        if place == goal:
            break
        if estimate > best[place] + heuristic[place] or edges_so_far > count[place]:
            continue
        for k in range(first[place], first[place + 1]):
            edge = edges[k]
            neighbour = end[edge]
            total, steps = best[place] + cost[edge], count[place] + 1
            better = total < best[neighbour] or (total == best[neighbour] and steps < count[neighbour])
            if hops[neighbour] != _NONE and better:
                best[neighbour], count[neighbour], arrived_by[neighbour] = total, steps, edge
                _sift_up(heap, heap_cost, heap_count, size, neighbour, total + heuristic[neighbour], steps)
                size += 1
    return arrived_by


@kernel
def _sift_up(heap: Ids, costs: Array, counts: Ids, size: int, place: int, cost: float, count: int) -> None:
    """Adds an entry to a binary heap of ``size``, least cost first, then fewest edges."""
    k = size
    while k > 0:
        above = (k - 1) // 2
        if costs[above] < cost or (costs[above] == cost and counts[above] <= count):
            break
        heap[k], costs[k], counts[k] = heap[above], costs[above], counts[above]
        k = above
    heap[k], costs[k], counts[k] = place, cost, count


@kernel
def _sift_down(heap: Ids, costs: Array, counts: Ids, size: int) -> None:
    """Moves the last entry, at ``size``, to the place that the first has left."""
    place, cost, count = heap[size], costs[size], counts[size]
    k = 0
    while 2 * k + 1 < size:
        below = 2 * k + 1
        right = below + 1
        if right < size and (
            costs[right] < costs[below] or (costs[right] == costs[below] and counts[right] < counts[below])
        ):
            below = right
        if cost < costs[below] or (cost == costs[below] and count <= counts[below]):
            break
        heap[k], costs[k], counts[k] = heap[below], costs[below], counts[below]
        k = below
    heap[k], costs[k], counts[k] = place, cost, count
