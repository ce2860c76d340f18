#!/bin/sh
# In the container, before it boots: installs landerd out of the wheel, and lets the checks begin.
set -eu
python3 "$(ls /checks/wheel/landerd-*.whl)/landerd" install --board pixhawk-usb
systemctl --quiet enable landerd
cp /checks/container.yaml /etc/landerd/landerd.yaml
UNITS=/etc/systemd/system
mkdir $UNITS/landerd.service.d
cp /checks/program.conf $UNITS/landerd.service.d
cp /checks/checks.service $UNITS
systemctl --quiet enable checks
