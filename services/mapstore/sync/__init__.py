"""Sharing maps with the fleet: finished ones go up, those of a plan come down, and nothing of it slows a drive.

:mod:`sharing` and :mod:`fetching` are the steps of one map, each of which may be repeated after a kill at any moment;
:mod:`engine` decides what is next, and when to try again.
"""
