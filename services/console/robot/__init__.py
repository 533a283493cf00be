"""The robot's page."""
