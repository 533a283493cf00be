"""A robot's processes under ``supervisor``: what ``vtr up``, ``vtr demo`` and the integration tests start and stop."""
