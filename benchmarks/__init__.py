"""Every claim about speed is a command here: ours and the raw library, side by side in one run."""
