"""The run-time library of components: calls, ports, worker and life cycle. Imports neither lark nor jinja2."""
