#!/bin/sh
# C unit tests under AddressSanitizer and UndefinedBehaviorSanitizer, with every compiler at hand; with gcc, whose runtime
# Python can preload, also records of contact laws that do not fit (tests/fuzz/test_law_records.py, BDAMPER_FUZZ cases).
set -eu
cd "$(dirname "$0")/.."
printf 'int main(void){return 0;}' > build-probe.c
trap 'rm -f build-probe.c' EXIT
tried=0
for cc in gcc clang; do
  command -v "$cc" >/dev/null 2>&1 || { echo "skipped: $cc is not installed"; continue; }
  "$cc" build-probe.c -llapack -lblas -o /dev/null 2>/dev/null || { echo "missing: LAPACK for the C tests (liblapack-dev)"; exit 1; }
  "$cc" -fsanitize=address,undefined build-probe.c -o /dev/null 2>/dev/null || { echo "skipped: $cc has no sanitizer runtime"; continue; }
  tried=1
  for plain in false true; do # the second time without extensions of the compiler
    dir=builddir-sanitize-$cc-plain-$plain
    rm -rf "$dir"
    CC=$cc meson setup "$dir" -Dctests=true -Dlapack=system -Dbuildtype=debugoptimized -Db_ndebug=false -Dplain=$plain \
      -Db_sanitize=address,undefined -Db_lundef=false >"$dir.log" 2>&1 || { cat "$dir.log"; exit 1; }
    rm -f "$dir.log"
    meson compile -C "$dir" >/dev/null
    ASAN_OPTIONS=detect_leaks=1 UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 meson test -C "$dir" --print-errorlogs
  done
  [ "$cc" = gcc ] || continue
  LD_PRELOAD="$(gcc -print-file-name=libasan.so)" ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 \
    BDAMPER_FUZZ="${BDAMPER_FUZZ:-2000}" OPENBLAS_NUM_THREADS=1 python tools/with_core.py builddir-sanitize-gcc-plain-false/_core.*.so \
    -q -n 0 -p no:cacheprovider tests/fuzz/test_law_records.py
done
[ "$tried" = 1 ] || { echo "missing: a compiler with sanitizers"; exit 1; }
