"""Joint files: their values, units, syntax and mistakes.

=================  ==========================================================
`quantity`         a number with its unit and source
`units`            any unit of the right dimension
`parameter_table`  which parameters there are, with units and ranges
`parameters`       the validated parameters of one joint
`effect_entries`   the tables of effects
`toml_format`      the syntax of a joint file
`joint_file`       reading and writing, and the joints that ship
`diagnosed`        the tables of a joint that a diagnosis found
`toolbox_files`    parameter files of the Compliant Joint Toolbox
`mistakes`         all mistakes in a file, reported at once
=================  ==========================================================
"""
