"""Physical models: vehicle, landing gear, gimbal, pad motion, battery, wind."""
