"""The autopilot's stand-in, its pilot and a fake ground station."""
