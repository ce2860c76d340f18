#!/bin/sh
# /opt/landerd/venv/bin/landerd of container and virtual machine.
PYTHONPATH=/repo exec python3 -m tests.devices.program "$@"
