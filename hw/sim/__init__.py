"""The simulated world: vehicle, wind, pad, gimbal, camera, autopilot stand-in, scorer."""
