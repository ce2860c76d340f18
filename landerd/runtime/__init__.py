"""What runs the core: the daemon, clocks, the service, dry runs."""
