"""Benchmarks: `python -m benchmarks` measures, prints and updates the tables of README.md."""
