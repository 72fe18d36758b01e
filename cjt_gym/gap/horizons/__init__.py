"""Quality of a joint's predictions at several horizons, and effects that improve them.

=============  ====================================================================
`log`          a record on an even time grid, with its gaps and measured states
`windows`      windows of it, from a few samples to half a second, and their starts
`coarse`       noise of a measured angle and of its slope
`forward`      predictions of a joint in the windows, by the joint's own kernel
`model`        a joint and the free numbers of its effects
`base_rows`    terms that are free in every fit
`rows`         rows of the effect table that may be added, and starts of their search
`fit`          least squares over all horizons at once
`baseline`     least-squares baseline
`predictable`  predictable part of an error, whatever its cause
`grow`         adding a term to a model or removing one, and its `worth`
`starts`       starting points of the search
`search`       rows that a record supports, and their `rivals`
`inverse`      what the torque is `spent` on, cogging `over_angle` among it
`instants`     which current a log writes into a row
`imposed`      motion that the torque does not determine
`judge`        the table of horizons, and which joint is the answer
`named`        which terms are named, and with which status
`tell`         the answer as a diagnosis
=============  ====================================================================
"""
