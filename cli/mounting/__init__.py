"""``vtr calibrate mounting``: where the camera sits on the vehicle, by driving a figure of eight."""
