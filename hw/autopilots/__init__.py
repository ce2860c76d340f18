"""Autopilot drivers."""
