#!/bin/sh
# Build the virtual machine of `make test-devices`: a Debian kernel and root with the kernel's own
# test devices (vivid). Needs root. Output in $OUT; about two minutes on an idle machine.
#   apt-get install --no-install-recommends qemu-system-x86 mmdebstrap busybox-static cpio kmod e2fsprogs
set -eu
OUT=${OUT:?where the machine is built}
rm -rf "$OUT"; mkdir -p "$OUT/kernel" "$OUT/initrd"

# Root: a plain directory, no kernel in it.
mmdebstrap --quiet --variant=minbase --mode=root --dpkgopt=force-unsafe-io \
    --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
    --include=systemd,systemd-sysv,udev,kmod,python3,v4l-utils bookworm "$OUT/root"

# Kernel: unpacked, never installed.
cd "$OUT/kernel"
apt-get -q download "$(apt-cache depends linux-image-amd64 | awk '/Depends:/{print $2; exit}')"
dpkg-deb -x linux-image-*.deb x
KERNEL=$(ls x/lib/modules)
cp "x/boot/vmlinuz-$KERNEL" "$OUT/vmlinuz"
depmod -b x "$KERNEL"

files() {  # of a module and of those it needs, in order
    modprobe -d "$OUT/kernel/x" -S "$KERNEL" --show-depends "$1" | awk '$1=="insmod"{print $2}'
}
mkdir -p "$OUT/root/lib/modules/$KERNEL"
for module in virtio_pci virtio_blk ext4 9p 9pnet_virtio virtio_rng vivid; do files $module; done |
    sort -u | sed "s,^$OUT/kernel/x/,," > modules.list
tar -C x -cf - -T modules.list | tar -C "$OUT/root" --keep-directory-symlink -xf -
cp x/lib/modules/"$KERNEL"/modules.builtin* x/lib/modules/"$KERNEL"/modules.order \
    "$OUT/root/lib/modules/$KERNEL/"
depmod -b "$OUT/root" "$KERNEL"

# What landerd needs, for the guest's Python.
python3 -m pip install -q --disable-pip-version-check --target "$OUT/root/opt/site" \
    --python-version 3.11 --only-binary=:all: opencv-contrib-python-headless numpy pyserial smbus2 \
    pyyaml pymavlink pydantic mcap
chroot "$OUT/root" python3 -m compileall -q /opt/site > /dev/null || true
echo /opt/site > "$OUT/root/usr/lib/python3/dist-packages/landerd.pth"
echo landerd-devices > "$OUT/root/etc/hostname"

# A small initramfs that mounts the disk, and the disk.
cd "$OUT/initrd"
mkdir -p bin dev mnt lib
cp /bin/busybox bin/busybox
n=10
for module in virtio_pci virtio_blk ext4; do files $module; done | awk '!seen[$0]++' |
    while read -r file; do n=$((n + 1)); cp "$file" "lib/$n-$(basename "$file")"; done
cat > init <<'INIT'
#!/bin/busybox sh
/bin/busybox mount -t devtmpfs dev /dev
for module in /lib/*.ko; do /bin/busybox insmod $module; done
i=0; while [ ! -b /dev/vda ] && [ $i -lt 100 ]; do /bin/busybox usleep 20000; i=$((i + 1)); done
/bin/busybox mount -t ext4 /dev/vda /mnt
exec /bin/busybox switch_root /mnt /lib/systemd/systemd
INIT
chmod +x init
find . | cpio -o -H newc --quiet > "$OUT/initrd.img"
MB=$(($(du -sm "$OUT/root" | cut -f1) * 5 / 4 + 64))
mke2fs -q -t ext4 -O ^has_journal -d "$OUT/root" "$OUT/disk.img" "${MB}m"
