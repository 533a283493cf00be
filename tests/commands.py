"""An operator's commands, written shortly."""

from common.messages import Command, Goal

_OF_A_GOAL = {"mode", "theta", "record", "pause_before", "pause_after"}


def command(action, goal=None, **fields):
    """A command whose goal is given in words, with what belongs to the goal beside it."""
    of_goal = {key: fields.pop(key) for key in _OF_A_GOAL & fields.keys()}
    return Command(action=action, goal=None if goal is None else Goal(to=goal, **of_goal), **fields)
