"""Calibration of cameras, gimbals and vehicles, and bench tests before the first flight."""
