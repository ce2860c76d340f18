#!/bin/sh
# What the virtual machine does: installs landerd as docs/install.md says, and runs the checks.
set -eu
cp -r /repo/config/. /etc/landerd
cp /repo/tests/devices/machine.yaml /etc/landerd/landerd.yaml
cp /repo/tests/devices/program.sh /opt/landerd/venv/bin/landerd
cp /repo/systemd/landerd.service /etc/systemd/system
# The processor is emulated: twenty times slower than a real one.
mkdir /etc/systemd/system/landerd.service.d
printf '[Service]\nTimeoutStartSec=300\nWatchdogSec=60\nTimeoutStopSec=30\n' > /etc/systemd/system/landerd.service.d/slow.conf
systemctl daemon-reload
cp /repo/systemd/99-landerd.rules /etc/udev/rules.d
udevadm control --reload
PYTHONPATH=/repo exec python3 -u -m tests.devices.drivers
