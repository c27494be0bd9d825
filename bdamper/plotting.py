"""Name of version 0.1: what stood here is :mod:`bdamper.plot`."""

raise ImportError("bdamper.plotting has gone with version 0.2: use bdamper.plot")
