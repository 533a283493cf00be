"""The fleet's server: what it derives from the maps of all robots."""
