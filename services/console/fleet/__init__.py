"""The page of the fleet: its robots and environments, what maps cost over a day, and the plan that follows.

* :mod:`snapshot` is what is known of the fleet at a moment, and :mod:`watch` keeps it by asking the fleet's server.
* :mod:`choice`, :mod:`day`, :mod:`robots`, :mod:`labels` compute what the page shows; :mod:`told` says it as JSON.
* :mod:`asked` is what a browser may ask, and :mod:`page` answers it.
"""
