"""What every room uses, and what knows nothing of structures and vibrations.

Checks of input and the errors they raise (`validate`, `errors`), files of results and their versions (`hdf5`, `versions`),
what a result prints and which function draws it (`repr`, `text`, `plotting`, `progress`), its table (`tables`), words for
what became of it (`status`), what it has cost (`cost`, `blas`), how accurate it is (`estimates`), and the one search for a
root on a line (`rootfind`).
"""
