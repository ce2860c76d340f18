#!/bin/sh
# `make test-devices`: the service under a real systemd in a container, the drivers on a real kernel's
# devices in a virtual machine. Both are built once, in $OUT. Skipped, saying so, where the tools are
# missing; with --or-skip also where they cannot be built (no network), and on a machine so busy that
# nothing comes in time.
set -eu
HERE=$(cd "$(dirname "$0")" && pwd)
REPO=$(cd "$HERE/../.." && pwd)
OUT=${OUT:-/var/tmp/landerd-devices}
LIMIT=${LIMIT:-900}  # of either, s

skip() {
    cat >&2 <<END
****************************************************************************************************
  SKIPPED: THE DEVICE TESTS WERE NOT RUN (drivers on a real kernel, service under a real systemd)
  $1
  They need root, Debian's archive, and: apt-get install --no-install-recommends qemu-system-x86 \\
      mmdebstrap systemd-container busybox-static cpio kmod e2fsprogs gcc make
****************************************************************************************************
END
    exit 0
}

missing=
for tool in qemu-system-x86_64 mmdebstrap systemd-nspawn busybox cpio modprobe mke2fs gcc make \
    apt-get; do command -v $tool > /dev/null || missing="$missing $tool"; done
[ -z "$missing" ] || skip "missing:$missing"
[ "$(id -u)" = 0 ] || skip "not root"
read -r load _ < /proc/loadavg
if [ "${1:-}" = --or-skip ] && [ "${load%.*}" -ge $((2 * $(nproc))) ]; then
    skip "the machine is too busy: load $load"
fi

KEY=$(cat "$HERE/build.sh" "$HERE/fake_pwm.c" | sha256sum)
if [ "$(cat "$OUT/built-from" 2> /dev/null)" != "$KEY" ]; then
    echo "building container and virtual machine in $OUT"
    if ! OUT=$OUT "$HERE/build.sh"; then
        [ "${1:-}" != --or-skip ] || skip "they could not be built"
        exit 1
    fi
    echo "$KEY" > "$OUT/built-from"
fi

WORK=$(mktemp -d)
BOX=$(mktemp -d)  # the container's root, and what it changes
clean_up() {
    for mount in "$BOX/root" "$BOX"; do
        ! mountpoint -q "$mount" || umount "$mount"
    done
    rm -rf "$WORK" "$BOX"
}
trap clean_up EXIT
chmod 755 "$WORK"
mkdir "$WORK/repo"
for part in landerd hw config systemd ardupilot tests pyproject.toml README.md LICENSE; do cp -r "$REPO/$part" "$WORK/repo"; done
find "$WORK/repo" -name __pycache__ -prune -exec rm -r {} +

# Two wheels: of what is here, and of a next version that has other keys.
PYTHON=$REPO/.venv/bin/python
[ -x "$PYTHON" ] || PYTHON=python3
wheel() {
    "$PYTHON" -m pip wheel -qq --disable-pip-version-check --no-deps -w "$WORK/$2" "$1" ||
        { echo "the wheel could not be built"; exit 1; }
}
wheel "$WORK/repo" wheel
cp -r "$WORK/repo" "$WORK/next"
sed -i 's/^version = .*/version = "99.0"/' "$WORK/next/pyproject.toml"
sed -i 's/min_ring_px: 10.0/min_ring_px: 9.0/' "$WORK/next/config/default.yaml"
wheel "$WORK/next" next-wheel

# Of the root, with changes that are thrown away.
mount -t tmpfs landerd-devices "$BOX"
mkdir "$BOX/upper" "$BOX/work" "$BOX/root"
mount -t overlay overlay "$BOX/root" \
    -o "lowerdir=$OUT/root,upperdir=$BOX/upper,workdir=$BOX/work"
container() {
    timeout -k 5 "$LIMIT" systemd-nspawn --quiet --register=no --keep-unit --private-network \
        --machine=landerd-devices --directory="$BOX/root" --bind="$WORK:/checks" --bind="$WORK/repo:/repo" "$@" < /dev/null
}
# Byte code is made here once: starting landerd without takes a minute in the virtual machine.
container python3 -m compileall -q /repo > "$OUT/container.log" 2>&1

mkdir "$WORK/only-tests"
cp -r "$WORK/repo/tests" "$WORK/only-tests"
cp "$HERE/container.yaml" "$HERE/program.conf" "$HERE/install.sh" "$HERE/checks.service" "$WORK"
container sh /checks/install.sh >> "$OUT/container.log" 2>&1 || cat "$OUT/container.log"
container --boot systemd.show_status=0 >> "$OUT/container.log" 2>&1 || true
cat "$WORK/service.txt" 2> /dev/null || { echo "the container did not boot:"; cat "$OUT/container.log"; }
grep -q "^ALL .* CHECKS OF THE SERVICE PASSED" "$WORK/service.txt" && service=0 || service=1

# TCG: /dev/kvm may be there and yet run no ordinary kernel.
timeout "$LIMIT" qemu-system-x86_64 -accel "${ACCEL:-tcg}" -M q35 -cpu max -smp 1 \
    -m 1024 -nodefaults -no-reboot -display none -kernel "$OUT/vmlinuz" -initrd "$OUT/initrd.img" \
    -append "console=ttyS0 quiet panic=-1 root=/dev/vda rw mitigations=off systemd.show_status=0 \
systemd.mask=systemd-timesyncd.service systemd.unit=kernel-command-line.target systemd.run=\"/bin/sh -c '\
modprobe 9pnet_virtio; mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=262144 repo /repo; \
/repo/tests/devices/machine.sh > /dev/ttyS0 2>&1'\" \
systemd.run_success_action=poweroff-force systemd.run_failure_action=poweroff-force" \
    -drive "file=$OUT/disk.img,format=raw,if=virtio,snapshot=on" -device virtio-rng-pci \
    -virtfs "local,path=$WORK/repo,mount_tag=repo,security_model=none,readonly=on,id=repo" \
    -serial stdio < /dev/null | tee "$OUT/console.log"
grep -q "^ALL .* CHECKS OF THE DRIVERS PASSED" "$OUT/console.log" && exit $service
exit 1
