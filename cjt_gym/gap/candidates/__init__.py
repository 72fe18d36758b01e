"""What could be the cause: one row per effect, by the stage in which the effect table has it.

============================  ==============================================
`candidate`                   definition of a row
`number`, `nuisances`         its numbers, and those that are free in every fit
`table`                       all rows that a record can reveal
`drive`, `motor`, `friction`  rows of the drive, the motor and its friction
`transmission`, `load`        rows of the springs and of the load
`sensing`, `released`         rows of the sensors; datasheet values set free
`outside`, `disturbance`      causes that the effect table does not have, as added signals
`separated`                   the experiments that tell one effect from another
============================  ==============================================
"""
