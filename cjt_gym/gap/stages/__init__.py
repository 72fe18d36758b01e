"""Effects found stage by stage: the joint is cut where it is measured, one residual per stage.

================================  ============================================================
`cut`                             the four stages and their residuals
`chain`, `kernel`, `predictor`    the predictor: linear chain, steady-state gain, friction
`stage_chains`, `gains`           chain and gain of each stage
`spring`, `force`                 torque of the torsion bar, torque of a motion
`process`, `sensing`              unspecified noise; channels that are worse than specified
`fit`, `quick`, `merit`           least squares, a quick look at one more effect, its price
`intervals`                       confidence intervals of a fit's numbers
`periodic`                        frequencies of ripple, steps of a command
`select`, `prune`                 which effects: beam search, leave one out
`lateness`                        dead time within a sample
`heldout`                         predictions of records that were not fitted
`leftover`                        what remains, and whether it is explained
`explain`                         all of these in order
`as_rows`                         the effects found as rows of the effect table
================================  ============================================================
"""
