"""``vtr keys``: a small certificate authority for one fleet, in a folder."""
