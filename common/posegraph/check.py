"""What is wrong with a pose graph, as sentences."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from common import geometry
from common.posegraph.graph import Edge, Experience, PoseGraph

_SYMMETRY = 1e-9
"""Largest asymmetry, and largest negative eigenvalue, of a covariance, relative to its largest element."""


def check(graph: PoseGraph) -> list[str]:
    """A sentence for each inconsistency of a pose graph; an empty list if it is sound.

    Building refuses what no graph can hold: edges and places at unknown vertices, gaps in the indices of an
    experience, two edges between the same vertices. Listed here is what a graph can hold and should not.
    """
    problems = list(_records(graph))
    for map_id, experience in graph.experiences.items():
        problems += _breaks(graph, map_id)
        problems += _isolation(graph, map_id, experience)
    for edge in graph.edges:
        problems += _edge(edge)
    problems += [f"place '{name}' is at unknown vertex {v}" for name, v in graph.places.items() if v not in graph]
    return problems


def _records(graph: PoseGraph) -> Iterator[str]:
    """Generations that do not follow from the parents'."""
    for map_id, experience in graph.experiences.items():
        record = experience.record
        if (record.parent is None) != experience.privileged:
            relation = "has a parent" if record.parent else "lacks a parent"
            yield f"map {map_id} is of generation {record.generation} and {relation}"
        parent = graph.experiences.get(record.parent or "")
        if parent is not None and record.generation != parent.record.generation + 1:
            yield f"map {map_id} is of generation {record.generation}, its parent of {parent.record.generation}"


def _breaks(graph: PoseGraph, map_id: str) -> Iterator[str]:
    """Vertices of an experience that no temporal edge joins to the one before."""
    vertices = graph.vertices(map_id)
    if not vertices:
        yield f"map {map_id} has no vertices"
    for before, vertex in itertools.pairwise(vertices):
        if before not in graph.neighbours(vertex, spatial=False):
            yield f"no temporal edge joins {before} and {vertex}"


def _isolation(graph: PoseGraph, map_id: str, experience: Experience) -> Iterator[str]:
    """A repeat that is joined to nothing serves nobody."""
    if experience.privileged:
        return
    joined = (n for vertex in graph.vertices(map_id) for n in graph.neighbours(vertex, spatial=True))
    if all(neighbour.map_id == map_id for neighbour in joined):
        yield f"map {map_id} was repeated, and no spatial edge joins it to another"


def _edge(edge: Edge) -> Iterator[str]:
    name = f"the edge from {edge.a} to {edge.b}"
    consecutive = edge.a.map_id == edge.b.map_id and abs(edge.a.index - edge.b.index) == 1
    if not edge.spatial and not consecutive:
        yield f"{name} is temporal, and its vertices do not follow each other"
    if not geometry.is_transform(edge.T_a_b.T):
        yield f"{name} has no rigid transform"
    covariance = edge.T_a_b.covariance
    tolerance = _SYMMETRY * float(np.abs(covariance).max())
    if not np.isfinite(covariance).all():
        yield f"{name} has a covariance that is not finite"
    elif np.abs(covariance - covariance.T).max() > tolerance:
        yield f"{name} has a covariance that is not symmetric"
    elif np.linalg.eigvalsh(covariance)[0] < -tolerance:
        yield f"{name} has a covariance with a negative variance"
