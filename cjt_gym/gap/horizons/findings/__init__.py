"""Which effects are named, how surely, and the diagnosis in words.

==================  ===========================================================
`by_torque`         effects that a regression of the torque shows as well
`naming_rules`      which terms may be named
`naming`            their status, numbers and rivals
`held_output`       what a held output leaves open
`not_confirmed`     what is never confirmed of a record that cannot identify it
`corrected_values`  values of the datasheet that a fit corrects
`verdict`           gap, stages, verdict and what stays unexplained
`disturbance`       a stretch in which something else acted
`plotted`           signals for the report
`found_joint`       the joint that was found, with its intervals
`as_diagnosis`      a judgement as a diagnosis
`stages_kept`       what stands of the stages' diagnosis
`answer`            the diagnosis, by stages or by horizons
==================  ===========================================================
"""
