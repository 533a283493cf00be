"""A fleet under a bad network: delay, loss and partitions between robots and their server, judged by what is kept.

``python -m bench.bad_network`` runs it, as root on Linux.
"""
