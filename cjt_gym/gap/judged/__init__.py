"""How an explanation is judged: by replays, intervals, and what fits as well.

=============  =================================================================
`replay`       the joint that a model stands for, driven by the recorded command
`closed_loop`  the same under the controller of the recording
`refine`       datasheet values refined by replay
`gap_size`     how far the gap shrinks on held-out data
`confusable`   explanations that the record cannot tell apart
`confidence`   from a lead in evidence to a probability
`naming`       which effects are named, and with what status
=============  =================================================================
"""
