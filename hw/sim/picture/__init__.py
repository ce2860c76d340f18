"""What the simulated camera shows, and when it delivers."""
