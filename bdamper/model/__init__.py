"""The model: bodies with their modes, interfaces, loads, and the checks of what a user gives."""
