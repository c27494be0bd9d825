"""
Effect of the rotation of the damper (Fig. 14)
===============================================

Response curves with and without the rotational modes of the damper at four preloads.

* The amplitude is underestimated without rotation. This holds at all four preloads, but the
  approximations of the paper exaggerate the effect: they give factors of 8, 4.7 and 2 at 100, 200
  and 1000 N; the converged factors are 1.5, 1.1 and 1.5.
* The frequency shift is overestimated without rotation. This holds at all four preloads, with
  converged values of 0.5 to 3 % instead of 4 to 11 %.
* There is no jump without rotation. This holds from 200 N upward with the settings of the paper,
  and from 1 kN upward for the converged results.
"""

import matplotlib.pyplot as plt
from paper_disk import MODES, ROTATION_PRELOADS, TRANSLATIONS, keep, print_curves, stored, study

import bdamper as bd
from bdamper.plot import plot_curves
from bdamper.plot.axes import STYLE

asked, band = study(1, **bd.CIGEROGLU_2009), MODES[1].band
translation = asked.replace(rigid_modes=TRANSLATIONS)
# curves of a damper that turns and of one that only translates
pairs = {
    "settings of the paper": [
        (asked.frequency_response(p, band), translation.frequency_response(p, band))
        for p in ROTATION_PRELOADS
    ],
    "converged": [
        (stored(f"mode_1_{p:g}N"), stored(f"translations_{p:g}N")) for p in ROTATION_PRELOADS
    ],
}
for name, found in pairs.items():
    for which, curves in zip(("all rigid modes", "translations only"), zip(*found)):
        print_curves(f"{name}, {which}", curves)

# %%
# The same frequencies in each column, the same amplitudes in both rows of it.

with plt.rc_context(STYLE):
    figure, axes = plt.subplots(2, 4, figsize=(10.0, 5.4), sharex=True, sharey="col")
for row, (name, found) in zip(axes, pairs.items()):
    for ax, pair in zip(row, found):
        title = f"preload {pair[0].preload:g} N,\n{name}"
        plot_curves(pair, ax, labels=("all rigid modes", "translations only"), title=title)
        ax.get_legend().remove()
        ax.set(
            xlabel=ax.get_xlabel() if ax in axes[1] else "",
            ylabel=ax.get_ylabel() if ax is row[0] else "",
        )
handles, labels = axes[0, 0].get_legend_handles_labels()
figure.legend(handles, labels, ncols=4, fontsize=8.0, loc="outside lower center")
keep(figure, "fig14_rotation")
