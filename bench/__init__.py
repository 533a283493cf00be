"""Measurements, each beside the peer that it is measured against."""
