"""Pictures of every result; the only room that imports matplotlib and pyvista."""

from bdamper.plot.plotting import *  # noqa: F403
