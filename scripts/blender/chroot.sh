#!/usr/bin/env bash
# A whole Blender, with a window, where only a Debian mirror can be reached: a Debian in a folder, for chroot.
# Usage, as root: scripts/blender/chroot.sh SUITE FOLDER [MOUNT …]. SUITE is sid (Blender 5.2.2 in November 2026) or
# trixie (4.3.2); the folders MOUNT are seen in there under the same names. FOLDER/blender starts that Blender.
# Before FOLDER is removed: umount -R what "findmnt -rno TARGET | grep ^FOLDER/" lists, or the mounted folders go with it.
set -euo pipefail
suite=$1
root=$2
shift 2
packages=(blender ca-certificates ffmpeg fonts-dejavu-core imagemagick libegl-mesa0 libgl1-mesa-dri libglx-mesa0 openbox
    python3-cattr python3-numpy python3-pytest python3-requests python3-zstandard xauth xdotool xvfb)

[ -d "$root/usr" ] || debootstrap --variant=minbase "$suite" "$root" http://deb.debian.org/debian
for folder in /proc /dev /sys "$@"; do
    mkdir -p "$root$folder"
    mountpoint -q "$root$folder" || { mount --rbind "$folder" "$root$folder" && mount --make-rslave "$root$folder"; }
done
cp /etc/resolv.conf "$root/etc/"
echo 'Acquire::Check-Valid-Until "false";' > "$root/etc/apt/apt.conf.d/99frozen" # mirrors may be snapshots
chroot "$root" apt-get update -qq
DEBIAN_FRONTEND=noninteractive chroot "$root" apt-get install -y -qq --no-install-recommends "${packages[@]}"

cat > "$root/blender" <<SCRIPT
#!/bin/sh
# In the folder from which it is called, if the chroot has it.
LIBGL_ALWAYS_SOFTWARE=1 exec chroot "$root" sh -c 'cd "\$0" 2>/dev/null; exec blender "\$@"' "\$PWD" "\$@"
SCRIPT
chmod +x "$root/blender"
"$root/blender" --version | head -n 1
