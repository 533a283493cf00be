"""Lets a velocity command through to the base, or stops the robot, and says why."""
