"""Regressions of the motor's torque on the motion.

=================  ==========================================================
`inverse`          inertia, friction, weight and offset as regressors
`bristles`         dry friction that builds up over a path, as a regressor
`over_angle`       a torque that repeats with the motor's angle
`cross_validated`  effects that a regression shows in all stretches of a log
`baseline`         the least squares that every diagnosis must at least match
=================  ==========================================================
"""
