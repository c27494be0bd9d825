#!/bin/sh
# Usage: test_kernels.sh [rounding]
# Runs the tests of the core and its C tests under each kernel of the core that this processor runs but does not choose.
# With "rounding", the tests that are marked so run too: under these kernels, and under two kernels of OpenBLAS.  Kernels
# that this processor does not run are skipped and named.
set -eu
cd "$(dirname "$0")/.."
python=.venv/bin/python
[ "${1:-}" = rounding ] && rounding=1 || rounding=""
runs=$($python -c 'from bdamper import _core; print(*_core.kernels())')
has() { case " $runs " in *" $1 "*) true ;; *) echo "skipped: $2, which needs $1, on this processor"; false ;; esac }

for kernel in plain generic avx2 avx512; do
  has $kernel "the $kernel kernel of the core" || continue
  [ "$kernel" != "${runs%% *}" ] || { echo "skipped: the $kernel kernel, which make test and make sanitize use on this processor"; continue; }
  echo "== core under its $kernel kernel"
  BDAMPER_KERNEL=$kernel $python -m pytest -q -n auto -m "not slow" tests/core
  for dir in builddir-sanitize-gcc-plain-false builddir-sanitize-clang-plain-false; do
    [ -d $dir ] || { echo "skipped: C tests of $dir, which make sanitize builds"; continue; }
    BDAMPER_KERNEL=$kernel .venv/bin/meson test -C $dir --no-rebuild --quiet --print-errorlogs
  done
  [ -z "$rounding" ] || BDAMPER_KERNEL=$kernel $python -m pytest -q -n auto -m "rounding and not slow"
done

[ -n "$rounding" ] || exit 0
own=$($python -c 'import scipy.linalg, threadpoolctl; print(*{one["architecture"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"})')
for pair in Haswell:avx2 SkylakeX:avx512; do
  type=${pair%:*}
  [ "$own" != "$type" ] || { echo "skipped: OpenBLAS as on $type, which make test runs with on this processor"; continue; }
  has ${pair#*:} "OpenBLAS as on $type" || continue
  echo "== tests that rounding touches, OpenBLAS as on $type"
  export OPENBLAS_CORETYPE=$type
  $python - <<'END'
import os

import scipy.linalg  # noqa: F401
import threadpoolctl

found = {(one["internal_api"], one["architecture"]) for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}
assert found == {("openblas", os.environ["OPENBLAS_CORETYPE"])}, f"BLAS that does not follow OPENBLAS_CORETYPE: {found}"
END
  $python -m pytest -q -n auto -m "rounding and not slow"
done
