"""Implements the faults of simulated flights; one file per kind of device."""
