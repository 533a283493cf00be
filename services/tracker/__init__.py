"""Follows a route: model-predictive control on the path of its vertices."""
