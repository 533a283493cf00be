"""The model of an environment: its places and maps, what each map costs at a time, and the best sequence of them.

The equations are those of Punia, *Map Management System for Visual Teach and Repeat Navigation*, 2023. :mod:`model` is
the environment as a file holds it, :mod:`table` the same as columns, :mod:`costs` the equations over those columns,
:mod:`network` the directed multigraph and the search in it, and :mod:`planning` the plan with its reasons.
"""

from common.environment.costs import MODES, Costs, Theta, map_costs
from common.environment.model import Environment, MapEntry, Model, read_environment
from common.environment.network import Network
from common.environment.planning import Plan, plan, warm_up
from common.environment.table import MapTable

__all__ = [
    "MODES",
    "Costs",
    "Environment",
    "MapEntry",
    "MapTable",
    "Model",
    "Network",
    "Plan",
    "Theta",
    "map_costs",
    "plan",
    "read_environment",
    "warm_up",
]
