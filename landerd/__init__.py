"""landerd: lands an ArduPilot multicopter on a marked pad by sight. This package decides."""

__version__ = "0.1.0"
