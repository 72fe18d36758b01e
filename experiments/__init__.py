"""Experiments whose results the documentation shows; they run from the repository.

`python -m experiments.loop` trains policies on joints that hide effects, before and after a
diagnosis; `python -m experiments.results` compares learned with classical controllers.
"""
