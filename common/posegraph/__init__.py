"""The spatio-temporal pose graph in memory (VT&R3): vertices, temporal and spatial edges, experiences."""

from common.posegraph.check import check
from common.posegraph.graph import Edge, Experience, PoseGraph
from common.posegraph.topology import from_topology, to_topology

__all__ = ["Edge", "Experience", "PoseGraph", "check", "from_topology", "to_topology"]
