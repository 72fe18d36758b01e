"""Effects found stage by stage: the joint is cut where it is measured, one residual per stage.

================================  ============================================================
`fields`                          the numbers that make a model, at their nominal values
`cut`                             the four stages and their residuals
`chain`, `kernel`, `predictor`    the predictor: linear chain, steady-state gain, friction
`spring`, `disturbance`, `force`  torque of the torsion bar, added signals, torque of a motion
`process`, `sensing`              unspecified noise; channels that are worse than specified
`number`, `nuisances`             numbers of a fit, and those that are free in every fit
`fit`, `quick`, `merit`           least squares, a quick look at one more effect, its price
`periodic`                        frequencies of ripple, steps of a command
`select`, `prune`                 which effects: beam search, leave one out
`lateness`                        dead time within a sample
`heldout`                         predictions of records that were not fitted
`leftover`                        what remains, and whether it is explained
`explain`                         all of these in order
`as_rows`                         the effects found as rows of the effect table
================================  ============================================================
"""
