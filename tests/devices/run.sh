#!/bin/sh
# `make test-devices`: landerd's drivers and its service against a real kernel and a real systemd, in
# a virtual machine that is built once. Skipped, saying so, where its tools are missing.
set -eu
HERE=$(cd "$(dirname "$0")" && pwd)
REPO=$(cd "$HERE/../.." && pwd)
OUT=${OUT:-/var/tmp/landerd-devices}
for tool in qemu-system-x86_64 mmdebstrap busybox cpio modprobe mke2fs; do
    if ! command -v $tool > /dev/null || { [ "$(id -u)" != 0 ] && [ ! -f "$OUT/disk.img" ]; }; then
        echo "SKIPPED: DEVICE TESTS WERE NOT RUN: they need root and $tool (see tests/devices/build.sh)" >&2
        exit 0
    fi
done
[ -f "$OUT/disk.img" ] || OUT=$OUT "$HERE/build.sh"
# TCG: /dev/kvm may be there and yet run no ordinary kernel.
timeout "${LIMIT:-600}" qemu-system-x86_64 -accel "${ACCEL:-tcg,thread=multi}" -M q35 -cpu max -smp 2 \
    -m 1024 -nodefaults -no-reboot -display none -kernel "$OUT/vmlinuz" -initrd "$OUT/initrd.img" \
    -append "console=ttyS0 quiet panic=-1 root=/dev/vda rw mitigations=off systemd.show_status=0 \
systemd.mask=systemd-timesyncd.service systemd.unit=kernel-command-line.target systemd.run=\"/bin/sh -c 'mkdir /repo; modprobe 9pnet_virtio; \
mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 repo /repo; \
PYTHONPATH=/repo python3 -u /repo/tests/devices/checks.py > /dev/ttyS0 2>&1'\" \
systemd.run_success_action=poweroff-force systemd.run_failure_action=poweroff-force" \
    -drive "file=$OUT/disk.img,format=raw,if=virtio,snapshot=on" -device virtio-rng-pci \
    -virtfs "local,path=$REPO,mount_tag=repo,security_model=none,readonly=on,id=repo" \
    -serial stdio < /dev/null | tee "$OUT/console.log"
grep -q "^ALL DEVICE CHECKS PASSED" "$OUT/console.log"
