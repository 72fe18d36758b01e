"""Which terms a record supports, and which joint predicts best.

===============  ==========================================================
`worth`          how much a term lowers the cost of a fit, and how clearly
`stepwise`       adding a term to a model, or removing one
`starts`         starting points of the search
`rivals`         terms that would fit as well in the place of another
`search`         forward search, then pruning
`search_result`  what a search found
`choice`         which of several joints is the answer
`contradiction`  held-out records that contradict the fitted ones
`judge`          the search, the answer and the table of horizons
`judgement`      what it returns
===============  ==========================================================
"""
