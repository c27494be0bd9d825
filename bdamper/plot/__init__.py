"""Plots of every result, the report, and the interactive explorer.

The only package that imports matplotlib.

Each plot function registers itself for a type of result in :mod:`bdamper.util.display`, so that
``result.plot()`` calls it.  Its arguments include axes ``ax`` (new axes if omitted) and ``title``.
`new_axes` and `save_figure` start and save a figure with several results, and `draw_table` plots
one column of a result against another.  `motion` computes motions and contact states as plain
arrays, `vtu` writes files for ParaView.  `explorer` serves a page with sliders on the loopback
interface (extra ``bdamper[app]``).
"""

from bdamper.plot.axes import colours as colours
from bdamper.plot.axes import new_axes as new_axes
from bdamper.plot.axes import save_figure as save_figure
from bdamper.plot.bodies import plot_import_report as plot_import_report
from bdamper.plot.bodies import plot_mode as plot_mode
from bdamper.plot.bodies import plot_model as plot_model
from bdamper.plot.bodies import plot_surfaces as plot_surfaces
from bdamper.plot.contact import plot_contacts as plot_contacts
from bdamper.plot.contact import plot_dissipation as plot_dissipation
from bdamper.plot.contact import plot_energy as plot_energy
from bdamper.plot.contact import plot_history as plot_history
from bdamper.plot.contact import plot_hysteresis as plot_hysteresis
from bdamper.plot.contact import plot_loops as plot_loops
from bdamper.plot.contact import plot_peak as plot_peak
from bdamper.plot.contact import plot_static as plot_static
from bdamper.plot.contact import plot_status_bars as plot_status_bars
from bdamper.plot.contact import plot_status_map as plot_status_map
from bdamper.plot.curves import mark_time_response as mark_time_response
from bdamper.plot.curves import plot_band as plot_band
from bdamper.plot.curves import plot_comparison as plot_comparison
from bdamper.plot.curves import plot_curve as plot_curve
from bdamper.plot.curves import plot_curves as plot_curves
from bdamper.plot.curves import plot_frequency_sweep as plot_frequency_sweep
from bdamper.plot.curves import plot_measurement as plot_measurement
from bdamper.plot.curves import plot_optimal as plot_optimal
from bdamper.plot.curves import plot_response_map as plot_response_map
from bdamper.plot.curves import plot_together as plot_together
from bdamper.plot.report import write_report as write_report
from bdamper.plot.speed_and_fatigue import plot_campbell as plot_campbell
from bdamper.plot.speed_and_fatigue import plot_critical as plot_critical
from bdamper.plot.speed_and_fatigue import plot_crossings as plot_crossings
from bdamper.plot.speed_and_fatigue import plot_haigh as plot_haigh
from bdamper.plot.speed_and_fatigue import plot_margin as plot_margin
from bdamper.plot.speed_and_fatigue import plot_safe as plot_safe
from bdamper.plot.speed_and_fatigue import plot_stress as plot_stress
from bdamper.plot.studies import draw_table as draw_table
from bdamper.plot.studies import plot_accuracy as plot_accuracy
from bdamper.plot.studies import plot_convergence as plot_convergence
from bdamper.plot.studies import plot_effect_significance as plot_effect_significance
from bdamper.plot.studies import plot_excitation_curve as plot_excitation_curve
from bdamper.plot.studies import plot_fit as plot_fit
from bdamper.plot.studies import plot_flutter as plot_flutter
from bdamper.plot.studies import plot_information as plot_information
from bdamper.plot.studies import plot_loop as plot_loop
from bdamper.plot.studies import plot_nonlinear_mode as plot_nonlinear_mode
from bdamper.plot.studies import plot_optimal_curve_uncertainty as plot_optimal_curve_uncertainty
from bdamper.plot.studies import plot_refinement as plot_refinement
from bdamper.plot.studies import plot_sensitivities as plot_sensitivities
from bdamper.plot.studies import plot_sweep as plot_sweep
from bdamper.plot.wheel import plot_blades as plot_blades
from bdamper.plot.wheel import plot_mistuning as plot_mistuning
from bdamper.plot.wheel import plot_periods as plot_periods
from bdamper.plot.wheel import plot_sample as plot_sample
from bdamper.plot.wheel import plot_sample_tail as plot_sample_tail
from bdamper.plot.wheel import plot_wheel as plot_wheel
from bdamper.plot.wheel import plot_wheel_map as plot_wheel_map
from bdamper.plot.wheel import plot_wheel_peak as plot_wheel_peak
