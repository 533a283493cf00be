"""The sensors: drivers that publish frames and wheel odometry; the synthetic world is one of them."""
