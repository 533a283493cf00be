"""The fleet's server: what all maps of an environment have in common, and which of them serve best at a time.

:mod:`intake` finds new maps in the storage, :mod:`catalog` keeps them as a graph, :mod:`rows` compares each new one
with the others, :mod:`spectrum` finds what repeats in the similarities, and :mod:`derived` keeps all that can be made
again.
"""
