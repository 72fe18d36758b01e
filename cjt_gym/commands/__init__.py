"""The subcommands of `cjt-gym`: each file has `add_arguments(parser)` and `run(options)`."""
