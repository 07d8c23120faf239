"""What interfaces mean: the waist between languages and wires. Immutable, free of syntax and of sockets."""
