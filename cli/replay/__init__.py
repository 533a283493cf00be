"""A recorded run again: the estimator of this version on what it was given then, and where two runs part.

* ``bus``: the estimator's inputs from a recording, its outputs kept, its map store beside it.
* ``run``: the estimator on such a bus.
* ``compare``: two runs, message by message.
"""
