"""Design studies: sweeps over settings, uncertainty, sensitivities."""
