"""What the processes share: bus, topics, messages, geometry, pose graph and configuration."""
