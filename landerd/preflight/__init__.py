"""Checks before a flight: devices are opened and measured, and each fact found is one finding.

Nothing here sends the vehicle anywhere. The gimbal is moved, but not while the vehicle is armed.
"""
