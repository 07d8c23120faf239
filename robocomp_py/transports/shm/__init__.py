"""Transport `shm`: shared memory of one machine, on iceoryx2."""

from .transport import ShmTransport

__all__ = ["ShmTransport"]
