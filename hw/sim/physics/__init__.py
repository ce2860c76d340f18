"""Bodies and air: vehicle, gear, gimbal, pad, wind."""
