"""Input checks, errors, files, tables, text, progress and root finding.

Nothing here depends on structures or vibration.  `validation` and `annotations` check arguments, `errors` and `warn`
report, `storage`, `checkpoint_file` and `versions` write and read HDF5 files, `tables`, `formatting` and `short_repr`
print, `display` finds the plot function of a result, `cost` counts operations and time, `rootfinding` finds a root on an
interval.
"""
