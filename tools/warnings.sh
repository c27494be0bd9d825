#!/bin/sh
# Builds the extension with every compiler at hand, warnings as errors.
set -eu
cd "$(dirname "$0")/.."
tried=0
for cc in gcc clang; do
  command -v "$cc" >/dev/null 2>&1 || { echo "skipped: $cc is not installed"; continue; }
  tried=1
  dir=builddir-warnings-$cc
  rm -rf "$dir"
  CC=$cc meson setup "$dir" -Dwerror=true >"$dir.log" 2>&1 || { cat "$dir.log"; exit 1; }
  meson compile -C "$dir" >"$dir.log" 2>&1 || { cat "$dir.log"; exit 1; }
  rm -rf "$dir" "$dir.log"
  echo "$cc: no warnings"
done
[ "$tried" = 1 ] || { echo "missing: gcc or clang"; exit 1; }
