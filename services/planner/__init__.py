"""The planner: routes over the pose graph."""
