"""Input checks, errors, result files, tables, text output, progress and root finding.

Nothing here depends on structures or vibration.

* ``validation`` checks arguments, ``plausible_ranges`` lists plausible values.
* ``errors`` defines errors, warnings and the words for statuses.
* ``storage`` reads and writes result files, ``tables`` exports them.
* ``formatting`` and ``display`` print and draw results.
* ``progress`` shows progress, handles interrupts and measures cost.
"""
