"""Gimbal drivers."""
