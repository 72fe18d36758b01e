"""How well a joint predicts tenths of seconds ahead, and the effects that make it predict better.

==============  ===================================================================
`prediction`    records in windows, and what a joint with free numbers does in them
`torque`        regressions of the motor's torque on the motion
`fitting`       rows of the effect table as terms, fitted to all horizons at once
`selection`     which terms a record supports, and which joint predicts best
`findings`      which of them are named, how surely, and the diagnosis in words
==============  ===================================================================

Each room imports only from those above it.
"""
