#!/bin/sh
# Compiles every C file with every compiler at hand, warnings as errors.
set -eu
cd "$(dirname "$0")/.."
include=$("${PY:-.venv/bin/python}" -c 'import numpy, sysconfig; print("-isystem", numpy.get_include(), "-isystem", sysconfig.get_path("include"))')
tried=0
for cc in gcc clang; do
  command -v "$cc" >/dev/null 2>&1 || { echo "skipped: $cc is not installed"; continue; }
  tried=1
  for file in csrc/*.c; do
    # shellcheck disable=SC2086
    "$cc" -std=c17 -O2 -Wall -Wextra -Wconversion -Wno-sign-conversion -Werror -fno-math-errno $include -Icsrc -fsyntax-only "$file"
  done
  echo "$cc: no warnings"
done
[ "$tried" = 1 ] || { echo "missing: gcc or clang"; exit 1; }
