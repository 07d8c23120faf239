"""Networks of components: what would run (`plan`, pure), what to do next (`policy`, pure), doing it (`run`)."""
