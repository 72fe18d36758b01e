"""Diagnosis of the gap between a recorded joint and its simulation: where, why, how far.

The modules, in the order in which a diagnosis uses them:

=================  ================================================================
`series`, `noise`  a record becomes even arrays with a known scatter
`setting`          the record together with its nominal joint
`fields`           the numbers that make a model, at their nominal values
`stages`           the joint cut where it is measured; one residual per stage
`kernel`, `chain`  the predictor: linear chain, steady-state gain, friction that may stick
`nuisances`        parameters that are free in every fit
`hypotheses`       one row per effect that may explain a gap
`fit`, `quick`     Levenberg-Marquardt, and a quick look at one more effect
`periodic`         frequencies of ripple, steps of a command
`select`, `prune`  which effects: beam search, leave one out
`sensing`          channels that are worse than specified
`unknown`          whether the rest is explained; which effects may be named
`localize`         where the gap lies
`replay`           the joint that a model stands for, driven by the recorded command
`gap_size`         how far the gap shrinks on held-out data
`intervals`        confidence intervals of the numbers
`confusable`       explanations that the record cannot tell apart
`naming`           which effects are named, and with what confidence
`menu`, `design`   inputs, and which of them would tell rivals apart
`suggest`          what to record next, and its excitation file
=================  ================================================================
"""

from cjt_gym.gap.diagnose import diagnose
from cjt_gym.gap.diagnosis import Diagnosis, NamedEffect

__all__ = ["Diagnosis", "NamedEffect", "diagnose"]
