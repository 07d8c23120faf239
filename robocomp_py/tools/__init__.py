"""Tools that look at a running network, and take part in it, by what its processes announce."""
