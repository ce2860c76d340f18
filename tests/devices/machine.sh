#!/bin/sh
# What the virtual machine does: puts things where `landerd install` does (making an environment
# takes too long here), and runs the checks.
set -eu
for group in dialout video i2c gpio; do groupadd -f -r $group; done
useradd --system --no-create-home --groups dialout,video,i2c,gpio landerd
mkdir -p /etc/landerd /opt/landerd/venv/bin
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
