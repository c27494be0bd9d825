#!/bin/sh
# Compiles and links the core for aarch64 Linux (Debian: gcc-aarch64-linux-gnu): the code must not be of one machine alone.
set -eu
cd "$(dirname "$0")/.."
compiler=aarch64-linux-gnu-gcc
command -v $compiler >/dev/null 2>&1 || { echo "skipped: no $compiler (Debian package gcc-aarch64-linux-gnu)"; exit 0; }
place=builddir-aarch64
rm -rf $place
cat >$place.ini <<'END'
[binaries]
c = 'aarch64-linux-gnu-gcc'
ar = 'aarch64-linux-gnu-ar'
strip = 'aarch64-linux-gnu-strip'
[host_machine]
system = 'linux'
cpu_family = 'aarch64'
cpu = 'aarch64'
endian = 'little'
END
trap 'rm -f $place.ini $place.log' EXIT
{ meson setup $place --cross-file $place.ini -Dwerror=true && meson compile -C $place; } >$place.log 2>&1 || { cat $place.log; exit 1; }
for core in $place/_core*.so; do
  aarch64-linux-gnu-readelf -h "$core" | grep -q AArch64 || { echo "$core is not for aarch64"; exit 1; }
done
echo "$core: built for aarch64"
