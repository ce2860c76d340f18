"""The simulated camera: the pictures it renders, and the times at which it delivers them."""
