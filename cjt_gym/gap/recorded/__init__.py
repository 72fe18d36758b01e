"""What was recorded: a record with its nominal joint, as arrays with a known scatter.

============  ==============================================================
`series`      evenly sampled arrays without gaps
`noise`       normal scatter of each channel
`fields`      the numbers of a joint and its effects, at their nominal values
`tolerances`  how sure the datasheet is of them
`setting`     a record together with its nominal joint and its noise
`cut`         what cuts a joint at its spring: a torque, or both angles
`signals`     torque and current between the samples
`orient`      signs and units of the channels, where physics determines them
`slope`       whether a measured velocity is that of its angle
`missing`     what a record cannot tell for want of a channel
`usable`      columns that stand for no measurement, records of several joints
`driven`      stretches that something other than the motor drives
`listed`      effects that the joint file lists, as parameters
============  ==============================================================
"""
