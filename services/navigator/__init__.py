"""The navigator: the state machine that takes the operator's commands."""
