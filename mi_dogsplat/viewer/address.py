"""Where a viewer listens: probed before viser does, which waits for ever where it cannot."""

from __future__ import annotations

import os
import socket

from ..support.errors import DataError

PORTS = 1000  # that viser tries, one after the other


def require_address(host: str, port: int) -> None:
    """Raise ``DataError`` for an address that is not this machine's, and where none of the ports is free.

    An empty address would be all of them.
    """
    remedy = "use 127.0.0.1, or 0.0.0.0 for all addresses"
    if not host:
        raise DataError("--host", "names no address", remedy)
    try:
        _bind(host, 0)
    except OSError as error:
        raise DataError("--host", f'cannot listen at "{host}" ({error.strerror or error})', remedy) from error
    if not any(_is_free(host, number) for number in range(port, min(port + PORTS, 65536))):
        raise DataError("--port", f"neither {port} nor one after it is free", "use another one")


def _bind(host: str, port: int) -> None:
    """Have a port for a moment. Raises ``OSError`` where that cannot be."""
    with socket.socket() as probe:
        if os.name == "posix":  # a port whose connections have just ended is free, as for viser
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))


def _is_free(host: str, port: int) -> bool:
    try:
        _bind(host, port)
    except OSError:
        return False
    return True
