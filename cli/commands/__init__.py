"""The commands: what their options are called, and which module does the work."""
