"""What the robot's page shows, made from messages; nothing here knows a bus or a browser."""
