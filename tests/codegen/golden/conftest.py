"""What lies here is compared and linted by tests beside it; it is no test itself."""

collect_ignore_glob = ["*"]
