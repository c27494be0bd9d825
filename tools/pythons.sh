#!/bin/sh
# Prints every supported Python of this machine that can make environments, the oldest first: on the path, or of pyenv.
for version in 3.11 3.12 3.13 3.14; do
  for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
    "$python" -c 'import ensurepip, venv' 2>/dev/null && { echo "$python"; break; }
  done
done
exit 0
