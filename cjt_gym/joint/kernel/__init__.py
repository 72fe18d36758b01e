"""The compiled physics of a joint, one joint at a time: every structure, drive and effect.

=================  ==============================================================
`control_steps`    the loops over control steps and joints
`substep`          one substep; `splitting` halves those that cannot be solved
`drives`           torque for a command; `current_loop` is that of a voltage drive
`heat`             temperatures of winding and housing
`friction`         of one body; `resistance` gathers all that resists a motion
`springs`          of gear and bar; `spring_table` is a measured one
`mesh`             what the gear transmits; `ripple` is in the angle
`load_forces`      gravity and contact; `disturbance` is what moves the load
`implicit_solver`  forces that depend on the motion over a substep
`sensing`          commands and measurements; `random_stream` is their noise
`discretize`       exact discretisation of many joints
`arrays`           the arrays that all of these work on
`compiled`         the decorators, and the cache; `compiling` reports progress
=================  ==============================================================
"""
