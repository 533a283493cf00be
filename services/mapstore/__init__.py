"""The map store: keeps the pose graph on the robot."""
