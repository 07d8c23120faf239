"""What runs in a component: calls, ports, the worker and its life. Imports neither lark nor jinja2."""
