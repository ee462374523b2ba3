"""Speaks nonsense to a game that serves the batch protocol at tcp://127.0.0.1:PORT, and checks that it is refused in a line each time and
that others are served on. Part of embed/game/check.

    python3 game/hostile.py PORT
"""

import random
import socket
import struct
import sys

HELLO = struct.pack("<4s5I", b"SFGW", 1, 10, 60, 64, 36)
BODY = struct.pack("<18f", *[1.8, 0.3, 11, 0.6, 3.14, 10, 20, 1, 0.6, 0.1, 60, 25, 6, 1, 14, 1, 38, 8])
REST = struct.pack("<194f", 1.53, 30.0, *[0.0, 0.0, 1.0] * 64)
NAN = float("nan")


def message(kind: int, body: bytes) -> bytes:
    return struct.pack("<2I", kind, len(body)) + body


def opened(count: int, body: bytes = BODY) -> bytes:
    return message(2, struct.pack("<I", count) + body + REST)


def entry(character: int, *values: float) -> bytes:
    return struct.pack("<I4f", character, *(values or (0.0,) * 4))


def decide(acting: int, placing: int, entries: bytes) -> bytes:
    return message(4, struct.pack("<2I", acting, placing) + entries)


SAID = message(1, HELLO)
READY = SAID + opened(4)
CASES = [
    ("HTTP", b"GET / HTTP/1.1\r\nHost: game\r\n\r\n"),
    ("zeros", bytes(64)),
    ("no hello", opened(4)),
    ("another version", message(1, HELLO[:4] + struct.pack("<I", 2) + HELLO[8:])),
    ("another magic", message(1, b"NOPE" + HELLO[4:])),
    ("a short hello", struct.pack("<2I", 1, 4) + b"SFGW"),
    ("an unknown kind", SAID + message(77, b"")),
    ("a message of 4 GiB", SAID + struct.pack("<2I", 4, 0xFFFFFFFF)),
    ("a long open", SAID + struct.pack("<2I", 2, 853)),
    ("no characters", SAID + opened(0)),
    ("too many characters", SAID + opened(4097)),
    ("a body that is not finite", SAID + opened(4, struct.pack("<18f", *[NAN] * 18))),
    ("two worlds", READY + opened(4)),
    ("a decision without a world", SAID + decide(0, 0, b"")),
    ("counts without entries", READY + decide(4, 4, b"")),
    ("counts that overflow", READY + decide(0x0CCCCCCD, 0, entry(0))),
    ("entries without counts", READY + decide(0, 0, entry(0))),
    ("a character that does not exist", READY + decide(1, 0, entry(4))),
    ("the same character twice", READY + decide(2, 0, entry(1) + entry(1))),
    ("characters that descend", READY + decide(0, 2, entry(2) + entry(1))),
    ("an action that is not finite", READY + decide(1, 0, entry(0, NAN, 0.0, 0.0, 0.0))),
    ("a place that is not finite", READY + decide(0, 1, entry(0, float("inf"), 0.0, 0.0, 0.0))),
]


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=20)


def read_all(connection: socket.socket) -> bytes:
    """What the game says until it closes the connection."""
    said = b""
    try:
        while True:
            part = connection.recv(1 << 16)
            if not part:
                return said
            said += part
    except ConnectionResetError:
        return said


def messages(said: bytes) -> list:
    found = []
    while said:
        kind, length = struct.unpack_from("<2I", said)
        found.append((kind, said[8 : 8 + length]))
        said = said[8 + length :]
    return found


def check_refusals(port: int) -> None:
    for name, sent in CASES:
        with connect(port) as connection:
            connection.sendall(sent)
            kind, text = messages(read_all(connection))[-1]
        assert kind == 0 and 0 < len(text) <= 512 and b"\n" not in text, f"{name}: {kind} {text!r}"


def check_service(port: int) -> None:
    """A sound session, byte by byte."""
    with connect(port) as connection:
        for byte in READY + decide(1, 1, entry(0, 1.0, 0.0, 0.0, 1.0) + entry(3, 1.0, 9.0, 1.0, 0.5)):
            connection.sendall(bytes([byte]))
        connection.shutdown(socket.SHUT_WR)
        kinds = [(kind, len(body)) for kind, body in messages(read_all(connection))]
    assert kinds == [(1, 24), (2, 0), (4, 680 + 356)], kinds


def check_cuts(port: int) -> None:
    """Sends truncated messages, and random bytes after a hello. None of them may disturb the game."""
    draw = random.Random(7)
    whole = READY + decide(4, 0, b"".join(entry(character) for character in range(4)))
    for _ in range(200):
        with connect(port) as connection:
            noise = draw.randbytes(draw.randrange(300))
            connection.sendall(whole[: draw.randrange(len(whole))] if draw.random() < 0.5 else SAID + noise)


def check_crowd(port: int) -> None:
    """More connections than there may be, and one that asks on and on without reading."""
    crowd = [connect(port) for _ in range(80)]
    for connection in crowd:
        connection.close()
    with connect(port) as deaf:
        deaf.setblocking(False)
        deaf.send(SAID + opened(4096))
        request = decide(0, 4096, b"".join(entry(character) for character in range(4096)))
        try:
            for _ in range(100):
                deaf.send(request)
        except BlockingIOError:
            pass
        check_service(port)


def main() -> None:
    port = int(sys.argv[1])
    for check in (check_refusals, check_service, check_cuts, check_crowd, check_service):
        check(port)
    print(f"  {len(CASES)} kinds of nonsense refused, others served")


if __name__ == "__main__":
    main()
