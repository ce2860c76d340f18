"""Markers in images: rings, squares, and the pose of the pad they make up."""

from landerd.vision.detectors import Detectors
from landerd.vision.vision import Vision

__all__ = ["Detectors", "Vision"]
