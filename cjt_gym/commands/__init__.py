"""The subcommands of `cjt-gym`: each file has `add_arguments(parser)` and `run(options)`.

`run` returns what `--json` prints and what else is printed, or None where it has said all itself.
"""
