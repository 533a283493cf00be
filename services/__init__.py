"""The processes of a robot: a folder each, alike in form."""
