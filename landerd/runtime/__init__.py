"""Code that runs the core: the daemon, the clocks, the systemd service, dry runs."""
