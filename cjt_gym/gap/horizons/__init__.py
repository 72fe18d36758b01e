"""How well a joint predicts a record at several horizons, and which rows of the effect table help.

=============  ====================================================================
`log`          a record as even arrays, with its gaps and its measured states
`windows`      pieces of it, from a few samples to half a second, and where they start
`forward`      what a joint predicts in each of them, by the joint's own kernel
`model`        a joint and the numbers of its effects that are free
`base_rows`    what is free in every fit
`rows`         which rows of the effect table may be added, and where their search starts
`fit`          least squares over all horizons at once
`baseline`     what five lines of least squares find
`predictable`  what of an error could still be predicted, whatever the cause
`grow`         one term more in a model, or one less, and what that is `worth`
`starts`       from where the search begins
`search`       which rows a record calls for, and their `rivals`
`judge`        the table of horizons, and which joint is the answer
=============  ====================================================================
"""
