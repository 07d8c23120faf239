"""The commands of `rcdeploy`. Each is a module with `add_arguments` and `run`; see `rcdeploy.COMMANDS`."""
