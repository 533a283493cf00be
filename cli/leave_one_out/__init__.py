"""`vtr leave-one-out`: one route at many times of day, each drive localized on every other."""
