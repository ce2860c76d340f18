"""Simulates one closed-loop flight, with the simulated autopilot or with SITL, and judges it."""
