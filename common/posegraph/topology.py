"""The pose graph as the message that travels, and back."""

from __future__ import annotations

import numpy as np

from common.errors import GraphError
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import MapSummary, Topology
from common.posegraph.graph import Edge, PoseGraph


def from_topology(topology: Topology) -> PoseGraph:
    """The pose graph of an environment's topology; its transforms are views of the message's arrays.

    Raises:
        GraphError: the arrays do not fit together, or a part contradicts another.
    """
    _check_arrays(topology)
    graph = PoseGraph(topology.environment)
    names: list[list[VertexId]] = []
    for summary in topology.maps:
        experience = graph.add_experience(summary.record)
        experience.finished, experience.bytes, experience.length = summary.finished, summary.bytes, summary.length
        experience.start_place, experience.end_place = summary.start_place, summary.end_place
        for index in range(summary.vertices):
            graph.add_vertex(VertexId(summary.record.id, index))
        names.append(graph.vertices(summary.record.id))
    ends, spatial_edges = topology.edges.tolist(), topology.spatial.astype(bool).tolist()
    columns = zip(ends, topology.T_a_b, topology.covariances, spatial_edges, strict=True)
    for (k_a, i_a, k_b, i_b), T, covariance, spatial in columns:
        graph.add_edge(Edge(names[k_a][i_a], names[k_b][i_b], Uncertain(T, covariance), spatial))
    for place, vertex in topology.places.items():
        graph.name_place(place, vertex)
    graph.restrictions.extend(topology.restrictions)
    return graph


def to_topology(graph: PoseGraph) -> Topology:
    """The topology of a pose graph, its maps and edges in the order in which they were added."""
    number = {map_id: k for k, map_id in enumerate(graph.experiences)}
    lengths = dict.fromkeys(graph.experiences, 0.0)
    for edge in graph.edges:
        if not edge.spatial:
            lengths[edge.a.map_id] += edge.length
    ends = [(number[e.a.map_id], e.a.index, number[e.b.map_id], e.b.index) for e in graph.edges]
    return Topology(
        environment=graph.environment,
        maps=[
            MapSummary(
                record=e.record,
                vertices=e.vertices,
                length=lengths[k],
                bytes=e.bytes,
                finished=e.finished,
                start_place=e.start_place,
                end_place=e.end_place,
            )
            for k, e in graph.experiences.items()
        ],
        edges=np.array(ends, dtype=np.int32).reshape(-1, 4),
        spatial=np.array([edge.spatial for edge in graph.edges], dtype=np.uint8),
        T_a_b=np.array([edge.T_a_b.T for edge in graph.edges]).reshape(-1, 4, 4),
        covariances=np.array([edge.T_a_b.covariance for edge in graph.edges]).reshape(-1, 6, 6),
        places=dict(graph.places),
        restrictions=list(graph.restrictions),
    )


def _check_arrays(topology: Topology) -> None:
    """Refuses arrays of different lengths, and edges whose ends no map of the topology has."""
    edges = topology.edges
    count = len(topology.T_a_b)
    if edges.shape != (count, 4) or topology.spatial.shape != (count,) or len(topology.covariances) != count:
        raise GraphError("the topology's arrays of edges differ in length")
    sizes = np.array([summary.vertices for summary in topology.maps] or [0], dtype=np.int64)
    for k, i in (edges[:, 0:2].T, edges[:, 2:4].T):
        inside = (k >= 0) & (k < len(topology.maps))
        inside &= (i >= 0) & (i < sizes[np.where(inside, k, 0)])
        if not inside.all():
            raise GraphError(f"edge {int(np.argmin(inside))} of the topology ends at a vertex that no map has")
