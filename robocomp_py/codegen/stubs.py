"""What an existing specific part still lacks."""

from __future__ import annotations

import ast

from ..contract.component import Component
from . import python as py


def missing_methods(source: str, component: Component) -> dict[str, str]:
    """Handlers that the text of a specificworker.py does not define, each with the stub to paste.

    A text that is no Python, or whose class takes methods from elsewhere, is not judged.
    """
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return {}
    worker = next((n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "SpecificWorker"), None)
    if worker is None or len(worker.bases) > 1:
        return {}
    defined = {n.name for n in worker.body if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)}
    stubs = {}
    for port in component.ports:
        if port.verb.has_proxy:
            continue
        for operation, _ in port.interface.under(port.verb):
            if port.handler(operation.name) not in defined:
                body = py.zero_return(operation) if operation.outputs else "..."
                doc = py.docstring(py.operation_doc(operation), 8)
                signature = py.handler_signature(port, operation)
                stubs[port.handler(operation.name)] = f"    {signature}\n        {doc}\n        {body}\n"
    return stubs


def missing_imports(source: str, component: Component) -> list[str]:
    """Modules whose types the handlers mention, but which a text does not import."""
    return [name for name in py.modules_handled(component.ports) if name not in source]
