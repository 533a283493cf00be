"""The estimator: frames in; odometry, vertices and localization out."""
