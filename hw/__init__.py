"""Devices, real and simulated. This package touches the world and decides nothing."""
