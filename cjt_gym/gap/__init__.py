"""Diagnosis of the gap between a recorded joint and its simulation: where, why, how far.

`diagnose` (in `diagnose.py`) runs the rooms in this order, and returns a `Diagnosis`:

=============  =============================================================
`check`        what the record can tell, before any fit
`recorded`     what was recorded: channels, their scatter, the nominal joint
`candidates`   what could be the cause: one row per effect
`stages`       effects found stage by stage, from sample to sample
`horizons`     effects found by predictions up to half a second ahead
`judged`       replays, intervals, rivals and names
`next_record`  what to record next
`report`       what is told: charts, page, summary
=============  =============================================================

`by_stages.py` makes a diagnosis of what the stages found; `horizons` has the last word.
"""

from cjt_gym.gap.check import Examination, examine
from cjt_gym.gap.diagnose import diagnose
from cjt_gym.gap.diagnosis import Diagnosis, NamedEffect

__all__ = ["Diagnosis", "Examination", "NamedEffect", "diagnose", "examine"]
