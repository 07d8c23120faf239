"""The commands of `rcdeploy`, a module each: what to parse, and one function to call. See `rcdeploy.COMMANDS`."""
