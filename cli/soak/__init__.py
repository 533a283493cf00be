"""``vtr soak``: a robot drives from goal to goal for a long time, while frames are lost and processes are killed."""
