"""Modelled sight: what vision would have found, made from simulated truth without pictures."""
