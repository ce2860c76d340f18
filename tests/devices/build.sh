#!/bin/sh
# Build what `make test-devices` runs in: a Debian root (for the container, and as the disk of the
# virtual machine) and a Debian kernel with its own test devices. Needs root and Debian's archive.
# Output in $OUT; about a minute and a half on an idle machine, 1.7 GB.
set -eu
HERE=$(cd "$(dirname "$0")" && pwd)
OUT=${OUT:?where it is built}
rm -rf "$OUT"
mkdir -p "$OUT/kernel" "$OUT/headers" "$OUT/pwm" "$OUT/initrd"

# Root: a plain directory, no kernel in it, nothing of landerd.
mmdebstrap --quiet --variant=minbase --mode=root --dpkgopt=force-unsafe-io \
    --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
    --include=systemd,systemd-sysv,udev,kmod,python3,python3-venv,v4l-utils bookworm "$OUT/root"
ROOT=$OUT/root
mkdir "$ROOT/repo"
echo landerd-devices > "$ROOT/etc/hostname"

# Kernel: unpacked, never installed.
download() { (cd "$1" && shift && apt-get -q -o APT::Sandbox::User=root download "$@" > /dev/null); }
download "$OUT/kernel" "$(apt-cache depends linux-image-amd64 | awk '/Depends:/{print $2; exit}')"
cd "$OUT/kernel"
dpkg-deb -x linux-image-*.deb x
KERNEL=$(ls x/lib/modules)
cp "x/boot/vmlinuz-$KERNEL" "$OUT/vmlinuz"
depmod -b x "$KERNEL"

files() {  # of a module and of those it needs, in order
    modprobe -d "$OUT/kernel/x" -S "$KERNEL" --show-depends "$1" | awk '$1=="insmod"{print $2}'
}
mkdir -p "$ROOT/lib/modules/$KERNEL"
for module in virtio_pci virtio_blk ext4 9p 9pnet_virtio virtio_rng autofs4 vivid i2c-dev i2c-stub \
    dummy_hcd g_serial usb_f_acm usb_f_serial cdc_acm; do files $module; done |
    sort -u | sed "s,^$OUT/kernel/x/,," > modules.list
tar -C x -cf - -T modules.list | tar -C "$ROOT" --keep-directory-symlink -xf -
cp x/lib/modules/"$KERNEL"/modules.builtin* x/lib/modules/"$KERNEL"/modules.order \
    "$ROOT/lib/modules/$KERNEL/"
depmod -b "$ROOT" "$KERNEL"

# A PWM chip, which Debian's kernel has no stand-in for; built with its headers, unpacked as well.
ABI=${KERNEL%-amd64}
download "$OUT/headers" "linux-headers-$KERNEL" "linux-headers-$ABI-common" \
    "linux-kbuild-${ABI%%.0-*}"
cd "$OUT/headers"
for package in *.deb; do dpkg-deb -x "$package" x; done
find x -type l | while read -r link; do
    target=$(readlink "$link")
    case $target in /usr/* | /lib/*) ln -sfn "$OUT/headers/x$target" "$link" ;; esac
done
SOURCES=x/usr/src/linux-headers-$KERNEL
grep -rl /usr/src/linux-headers "$SOURCES" --include=Makefile |
    xargs -r sed -i "s,/usr/src/linux-headers,$OUT/headers/x/usr/src/linux-headers,g"
cp "$HERE/fake_pwm.c" "$OUT/pwm"
echo 'obj-m := fake_pwm.o' > "$OUT/pwm/Makefile"
make -s -C "$SOURCES" "M=$OUT/pwm" modules 2> "$OUT/pwm/log" || { cat "$OUT/pwm/log"; exit 1; }
cp "$OUT/pwm/fake_pwm.ko" "$ROOT/opt"

# What landerd needs, for the root's Python.
PYTHON=$HERE/../../.venv/bin/python
[ -x "$PYTHON" ] || PYTHON=python3
"$PYTHON" -m pip install -qq --disable-pip-version-check --target "$ROOT/opt/site" \
    --python-version 3.11 --only-binary=:all: opencv-contrib-python-headless numpy pyserial smbus2 \
    pyyaml pymavlink pydantic mcap
chroot "$ROOT" python3 -m compileall -q /opt/site > /dev/null || true
echo /opt/site > "$ROOT/usr/lib/python3/dist-packages/landerd.pth"

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
MB=$(($(du -sm "$ROOT" | cut -f1) * 5 / 4 + 64))
rm -rf "$OUT/headers" "$OUT/kernel"
mke2fs -q -t ext4 -O ^has_journal -d "$ROOT" "$OUT/disk.img.new" "${MB}m" > /dev/null
mv "$OUT/disk.img.new" "$OUT/disk.img"  # it is there only if all has been built
