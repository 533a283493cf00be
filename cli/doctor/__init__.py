"""What ``vtr doctor`` checks."""
