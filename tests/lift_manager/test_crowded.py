"""A running manager whose connections are all taken: whoever has to reach it still does."""

import socket
from contextlib import ExitStack
from pathlib import Path

from tests.lift_manager.test_keys_in_use import command, site_file
from tests.lift_manager.test_operate import LIFT
from tests.support.programs import LIFT_MANAGER, started

FILES = 256
"""So few that a quarter of them, 64, are connections."""
CROWD = 200


def connections(stack: ExitStack, port: int, sent: bytes) -> list[socket.socket]:
    """Open a crowd of connections, send the same on each and read what comes first; some may be closed."""
    crowd = []
    for _ in range(CROWD):
        crowd.append(stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60)))
        crowd[-1].sendall(sent)
        crowd[-1].recv(1)
    return crowd


def test_neither_idle_connections_nor_the_streams_of_a_key_keep_a_person_from_locking_a_lift(tmp_path: Path) -> None:
    file = site_file(tmp_path, host="127.0.0.1")
    keys = {role: command("keys", "make", file, "--name", role, "--role", role) for role in ("viewer", "operator")}
    limited = ("sh", "-c", f'ulimit -n {FILES} && exec "$@"', "sh", *LIFT_MANAGER)
    with started(*limited, "serve", str(file), "--port", "0") as manager:
        url = manager.says(r"(http://127\.0\.0\.1:(\d+))/docs")
        port = int(url[2])
        words = (LIFT, "--by", "M. Weber", "--manager", url[1])
        head = f"Host: 127.0.0.1:{port}\r\nAuthorization: Bearer {keys['viewer']}\r\n\r\n".encode()
        with ExitStack() as stack:
            connections(stack, port, f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            command("lockout", *words, "--reason", "new ropes", key=keys["operator"])
        with ExitStack() as stack:
            connections(stack, port, b"GET /api/v1/events HTTP/1.1\r\n" + head)
            command("lockout", *words, "--end", key=keys["operator"])
        assert "all 64 places for connections are taken" in manager.err
