"""`vtr demo`: a route taught and repeated in the synthetic world by a robot's own processes."""
