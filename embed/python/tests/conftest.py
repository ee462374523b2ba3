"""A small level, and world servers of their own. SUREFOOT names the program."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import surefoot

PROGRAM = os.environ.get("SUREFOOT", str(Path(__file__).parents[3] / "target/release/surefoot"))


class Process:
    """A world server that can be stopped and started again at the same address."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.log = folder / "serve.log"
        self.start()

    @property
    def uri(self) -> str:
        return f"grpc://127.0.0.1:{self.port}"

    def start(self) -> None:
        with self.log.open("ab") as log:
            self.process = subprocess.Popen([PROGRAM, "serve", "--listen", f"127.0.0.1:{self.port}"], stdout=log, stderr=log)
        while subprocess.run([PROGRAM, "health", f"http://127.0.0.1:{self.port}"], capture_output=True).returncode != 0:
            assert self.process.poll() is None, self.log.read_text()

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture(scope="session")
def level() -> surefoot.Level:
    """A small level."""
    return surefoot.Level.generate(7, size=60)


@pytest.fixture(scope="session")
def islands() -> surefoot.Level:
    """A small level over a void."""
    return surefoot.Level.generate(3, size=60, kind="islands")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    """A server for the tests of a file."""
    process = Process(tmp_path_factory.mktemp("server"))
    yield process
    process.stop()
