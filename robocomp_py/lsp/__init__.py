"""The language server: what an editor asks about models, answered. `server` is the shell, the rest is pure."""
