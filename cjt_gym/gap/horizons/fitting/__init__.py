"""Rows of the effect table as terms, fitted to all horizons at once.

===================  ==========================================================
`terms`              rows that may explain a record, and starts of their search
`base_terms`         terms that are free in every fit
`user_effects`       terms of effects that a user has added to the table
`datasheet`          tolerances of what the datasheet states
`fit`                least squares over all horizons
`parallel`           independent fits in threads
`uncertainty`        of a fit's numbers
`covariance`         of the numbers of a joint file
`input_instants`     which input a log writes into a row
`imposed_motion`     fits of motion that the torque does not determine
`balanced_friction`  joints in which dry friction all but balances the torque
===================  ==========================================================
"""
