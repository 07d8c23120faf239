"""gRPC: unary calls, which its guide recommends for Python instead of streams, on one channel that stays.

Messages are octets, without Protocol Buffers between, which would copy once more; sizes are not limited. On this
host, a Unix socket is no quicker than the loopback interface, and asyncio no quicker than threads.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
import numpy as np

from .driver import Array, drive, main, until_told

_SERVICE, _METHOD = "benchmarks.Echo", "echo"
_OPTIONS = [("grpc.max_send_message_length", -1), ("grpc.max_receive_message_length", -1)]
_PATIENCE = 10.0


def far(folder: str, port: str) -> None:
    server = grpc.server(ThreadPoolExecutor(max_workers=2), options=_OPTIONS)
    echo = grpc.unary_unary_rpc_method_handler(
        lambda data, _: data, request_deserializer=_decode, response_serializer=_encode
    )
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(_SERVICE, {_METHOD: echo}),))
    server.add_insecure_port(_address(port))
    server.start()
    try:
        until_told()
    finally:
        server.stop(None).wait(_PATIENCE)


def near(folder: str, port: str) -> None:
    with grpc.insecure_channel(_address(port), options=_OPTIONS) as channel:
        ask: Any = channel.unary_unary(
            f"/{_SERVICE}/{_METHOD}", request_serializer=_encode, response_deserializer=_decode
        )
        end = time.monotonic() + _PATIENCE
        while True:
            try:
                ask(np.zeros(1, np.uint8), timeout=_PATIENCE)
                break
            except grpc.RpcError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)
        drive(ask, folder)


def _address(port: str) -> str:
    return f"127.0.0.1:{port}"


def _encode(data: Array) -> bytes:
    return data.tobytes()


def _decode(message: bytes) -> Array:
    return np.frombuffer(message, np.uint8)


if __name__ == "__main__":
    main(far=far, near=near)
