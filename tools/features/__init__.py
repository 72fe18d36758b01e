"""What the toolbox can do, with the command that does it here: python -m tools.features."""
