"""Calibration of a stereo pair with a ChArUco board, rectification by it, and how the pair is mounted. No bus here."""
