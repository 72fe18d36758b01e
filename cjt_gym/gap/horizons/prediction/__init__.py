"""Records in windows, and what a joint with free numbers predicts in them.

=============  ===============================================================
`log`          a record on an even time grid, with its gaps and measured states
`pieces`       pieces of it: what evidence is counted in, or held out
`placement`    where windows of it start, and what each stands for
`windows`      windows of it, from a few samples to half a second
`angle_noise`  noise of a measured angle, and of its slope
`drive`        what a drive does between command and measured current
`model`        a joint and the free numbers of its effects
`observer`     states that a record lacks, estimated by a filter of the joint
`forward`      predictions in the windows, by the joint's own kernel
`case`         the records to fit and to hold out, with their nominal joint
`predictable`  predictable part of an error, whatever its cause
=============  ===============================================================
"""
