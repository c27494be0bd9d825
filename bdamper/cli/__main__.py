"""Runs the command as ``python -m bdamper.cli``; see the room."""

import sys

from bdamper.cli.command import main

sys.exit(main())
