"""The robot's Zenoh router."""
