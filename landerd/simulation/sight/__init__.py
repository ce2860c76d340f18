"""Sight without pictures: what vision would have found, drawn from simulated truth."""
