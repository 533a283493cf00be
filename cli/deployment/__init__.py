"""What an operating system needs to start a robot, or the fleet's server, without anybody logging in."""
