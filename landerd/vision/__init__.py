"""Markers in images: rings, squares, and the pose of the pad they make up."""

from landerd.vision.vision import Vision

__all__ = ["Vision"]
