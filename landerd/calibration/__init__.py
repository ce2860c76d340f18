"""Calibration of cameras from views of a board."""
