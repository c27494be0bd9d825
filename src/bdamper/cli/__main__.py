"""Runs the command as ``python -m bdamper.cli``; see the room."""

import sys

from bdamper.cli.command import main

if __name__ == "__main__":
    sys.exit(main())
