"""Looks for things in the robot's way, by lidar or by stereo, for safety to stop before them."""
