"""
Response curves of the first two blade modes (Figs 6 and 7)
===========================================================

A disk of 65 blades with a wedge damper between neighbouring blades is excited by engine order 5 at
the trailing-edge corner of the tip: with 1 N in the tangential direction for mode 1, with 12 N in
the radial direction for mode 2, as in the paper.  (The middle of the tip lies on a nodal line of
the radial motion in mode 2.)  Every curve is followed through its folds; unstable parts are dashed.
The right-hand figures show the converged results for the same model.

The results confirm that with increasing preload the resonance moves to higher frequencies, and the
amplitude decreases to an optimum and then rises to that of the stuck damper. The position and depth
of the optimum are the subject of Figs 8 and 9.
"""

from paper_disk import MODES, keep, plot_beside, print_curves, stored, study

import bdamper as bd

paper, converged = {}, {}


def tracking(mode: int) -> None:
    """Compute the curves at each preload with the settings of the paper, load the stored converged
    curves, and draw and print both.
    """
    driven, asked, rich = MODES[mode], study(mode, **bd.CIGEROGLU_2009), study(mode)
    paper[mode] = [
        asked.frequency_response(preload, driven.band, stability=True)
        for preload in driven.preloads
    ]
    converged[mode] = [stored(f"mode_{mode}_{preload:g}N") for preload in driven.preloads]
    limits = [[s.free(driven.band), s.stuck(driven.band)] for s in (asked, rich)]
    print_curves("settings of the paper", paper[mode])
    print_curves("converged", converged[mode])
    figure = plot_beside(
        limits[0] + paper[mode], limits[1] + converged[mode], f"Mode {mode}, {driven.name}"
    )
    keep(figure, f"fig0{5 + mode}_tracking_mode_{mode}")


# %%
# **Fig. 6.** Mode 1 has several solutions at one frequency, an unstable one between two stable ones, where the faces
# separate: holds, with the settings of the paper and converged.  Next to the folds disturbances that oscillate grow, too.

tracking(1)

# %%
# **Fig. 7.** Mode 2 has none: holds from 250 N on, near the optimum, in both.  At 50 and 120 N, a fifth and a half of it,
# there are folds.

tracking(2)
