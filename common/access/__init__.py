"""Who may do what on the bus.

* :mod:`common.access.names`: roles, and the common names of certificates.
* :mod:`common.access.register`: the certificates that were issued, and which of them count.
* :mod:`common.access.rights`: what each role and each process may do, from ``common/topics.py``.
* :mod:`common.access.control`: the same as Zenoh's ``access_control``.
* :mod:`common.access.link`: what a session's configuration gets of all this.
"""
