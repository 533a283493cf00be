"""The planner: routes over the pose graph, and over the maps that serve best now.

:mod:`choice` chooses maps between two places (the thesis), :mod:`joints` lays a route over them, :mod:`route` is the
shortest way over what was taught here, :mod:`memory` keeps what was learnt of the fleet, and :mod:`fleet` asks it.
"""
