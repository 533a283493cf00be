"""The web console: pages in a browser that show a robot, and an operator's commands from them."""
