"""What an interface adds to the names of its Python module, besides those of its types."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .interface import Verb


def interface_constant(interface: str) -> str:
    """Where generated code keeps an interface: `LASER_INTERFACE`."""
    return f"{interface.upper()}_INTERFACE"


def operation_constant(interface: str, operation: str) -> str:
    """Where generated code keeps an operation: `_Laser_getLaserData`."""
    return f"_{interface}_{operation}"


def proxy_class(interface: str, verb: Verb) -> str:
    """The class through which an interface is used: `LaserProxy`, `LaserPubPublisher`."""
    return f"{interface}{'Publisher' if verb.is_topic else 'Proxy'}"


def names_of(interface: str, operations: Iterable[str]) -> Iterator[str]:
    """All of them, whatever a component does with the interface."""
    yield interface_constant(interface)
    yield proxy_class(interface, Verb.REQUIRES)
    yield proxy_class(interface, Verb.PUBLISHES)
    yield from (operation_constant(interface, operation) for operation in operations)


def feedback_struct(interface: str, action: str) -> str:
    """The name of the struct of an action's feedback: `NavigationGoToFeedback`."""
    return f"{_joined(interface, action)}Feedback"


def goal_class(interface: str, action: str) -> str:
    """The class of what the handler of an action with feedback gets: `NavigationGoToGoal`."""
    return f"{_joined(interface, action)}Goal"


def _joined(interface: str, operation: str) -> str:
    return "".join(word[:1].upper() + word[1:] for word in (*interface.split("_"), *operation.split("_")))
