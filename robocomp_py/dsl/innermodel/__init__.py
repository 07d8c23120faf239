"""InnerModel files as one of the languages: what is wrong with them, as diagnostics."""
