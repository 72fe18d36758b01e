"""Learned against classical, for anyone to repeat.

For each structure a policy is trained from several seeds by one recipe, and meets every classical
controller on episodes, parameter draws and tasks that no training saw; then on joints that none
saw, in a wider box of parameters, with more delay, at the worst parameters of the box, and with its
output moved from outside.

    python -m experiments.results --out results
"""
