"""The command `vtr`."""
