"""``vtr chaos``: faults in every process of a robot that teaches and repeats, judged by the synthetic world's truth."""
