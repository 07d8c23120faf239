"""A scene of InnerModel in the browser: shown from a file or as it runs, and edited. Needs the extra `[viewer]`.

`shapes` and `editor` know nothing of the browser; `stage`, `page` and `desk` are their face there, by viser.
"""
