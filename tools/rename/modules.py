"""Old module -> new module, one to one (merging comes later)."""
T = """
util: errors warn status validate>validation marks>annotations hdf5>storage versions results_file>checkpoint_file tables text>formatting repr>short_repr plausible>plausible_ranges plotting>display differences progress cost blas>threading rootfind>rootfinding
model: model/model>structure model/stress>stress_recovery model/basis>modal_basis model/shapes>rigid_motions model/local>local_basis model/relative_motion>kinematics model/spin>rotation model/loads model/coarsening>patch_merging model/misfit>surface_misfit model/completion>residual_vectors model/validation model/checks>fields io/model_file>model_file io/model_groups>hdf5_records
fem: reduction/cyclic>cyclic_symmetry reduction/waves>travelling_waves reduction/sector_faces reduction/bodies>reduced_bodies reduction/free_body reduction/spin>rotation reduction/facets>element_faces reduction/structure>fe_matrices reduction/patches>contact_patches reduction/local_coordinates>sector_local_basis reduction/element_stress reduction/stress>stress_rows fe/mesh fe/geometry fe/assemble>assembly fe/parts>model_parts fe/spin>geometric_stiffness fe/reference>bladed_disk_model fe/sector>sector_matrices fe/blade_to_ground>blade_to_ground_model fe/large>generated_models fe/contact_points fe/stress>blade_stress shipped>reference_models
importers: io/fe_body io/reading>reader_registry io/bounds>import_tolerances io/ansys io/calculix>abaqus io/nastran io/matrices>array_files io/matlab io/matrix_market io/universal_file io/prepare>prepared_body io/plausible>plausibility io/contact_faces io/from_matrices>bodies_from_matrices io/from_modes>bodies_from_modes io/over_speed>two_speeds io/local_from_matrices>imported_local_basis io/imported_stress>stress_rows io/build io/built_model>import_report io/force_field io/measured>measurements io/keywords>deck_keywords
contact: contact/laws>law_codes contact/points>point_parameters contact/own_law>user_laws contact/contract>law_checks contact/stiffness contact/residual_modes>residual_flexibility contact/preload>static_state contact/preload_forces>full_static_contact contact/wedge>wedge_statics
harmonic_balance: harmonic_balance/equations harmonic_balance/conditions>closing_conditions harmonic_balance/system>sector harmonic_balance/linear>linear_limits harmonic_balance/family>speed_family harmonic_balance/cycle>contact_cycle harmonic_balance/modes>nonlinear_mode_equations problem/problem problem/settings problem/effects problem/at_speed>rotor_speed problem/loads>normal_loads problem/stiffness>stiffness_choice contact/no_separation>closed_contact problem/variation>parameters problem/aligned>residual_mode_alignment problem/plausible>plausibility problem/sizes>model_sizes problem/results>result_checks problem/asked>study_dispatch
response: continuation/follower>continuation continuation/events continuation/path>continuation_options continuation/coverage>branches continuation/start>initial_solution continuation/track>response_curve continuation/unloaded>zero_preload continuation/mean_position continuation/rattle>rattle_detection continuation/slow_sweep>quasi_static_sweep continuation/curve continuation/linear_curve peaks/newton>peak peaks/interval>resonance_interval peaks/highest>highest_peak peaks/least>minimum_search peaks/optimal>optimal_curve peaks/at_preload>preload_point peaks/optimal_curve>optimal_curve_result peaks/sensitivity design/sensitivity>setting_derivatives util/kept>march_result util/convergence>convergence_result util/estimates>error_estimate_result
time_domain: stability/time_integration>integration stability/march stability/kept>steady_amplitude peaks/marched>optimum_in_time stability/settled>settling stability/time_sweep>frequency_sweep stability/floquet stability/disturbances>wave_exponents stability/in_time>time_domain_labels
analyses: accuracy/converge>harmonic_convergence accuracy/ladders>accuracy_cost accuracy/estimate>error_estimates effects/indicator>change_estimate effects/richer>refined_peak effects/advice>effect_selection effects/comparison>study_comparison effects/hysteresis design/microslip design/sweep design/workers>executors design/uncertainty peaks/best_margin>optimal_margin design/fit design/loop>loop_fit design/residuals>response_residuals modes/mode>nonlinear_mode modes/result>nonlinear_mode_result modes/flutter speed/campbell speed/run_up speed/crossings speed/line>engine_order_line speed/family>speed_family
fatigue: fatigue/cycle>stress_cycle fatigue/criteria fatigue/material fatigue/margin
mistuning: wheel/mistuning wheel/structure wheel/system>wheel_equations model/local_model>tuned_wheel_model wheel/wheel_problem wheel/loading>loaded_wheel wheel/static wheel/peak wheel/results>peak_result wheel/search>peak_search wheel/reduction>reduced_wheel wheel/band>frequency_band wheel/statistics wheel/sample wheel/sample_result wheel/wheel wheel/optimal wheel/track>response_curve wheel/kept>steady_amplitude
plot: plot/axes plot/curves plot/response_map plot/together>overlay plot/contact plot/hysteresis plot/motion plot/model3d plot/vtu plot/design>study_plots plot/table>column_plot plot/fit plot/modes plot/speed plot/fatigue plot/wheel plot/report app/explorer app/page>explorer_page app/answers>explorer_worker app/rescaled>force_scaling
top: study masses>lumped_masses cli/command>__main__
"""
def mapping():
    out = {}
    for line in T.strip().splitlines():
        pkg, rest = line.split(":")
        for w in rest.split():
            old, _, new = w.partition(">")
            base = old.split("/")[-1]
            new = new or base
            if pkg == "util" and "/" not in old: old = "util/" + old
            o = old.replace("/", ".")
            n = new if pkg == "top" else f"{pkg}.{new}"
            assert o not in out, o
            out[o] = n
    assert len(set(out.values())) == len(out), [v for v in out.values() if list(out.values()).count(v) > 1]
    return out
