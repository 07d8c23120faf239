"""Each is a module: `with_dsl` and `by_hand` do the same to a project, and `behaves` shows that it was done."""
