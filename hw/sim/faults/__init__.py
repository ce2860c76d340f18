"""What goes wrong in a simulated flight: one file a kind of device."""
