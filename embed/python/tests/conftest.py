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

    def __init__(self, folder: Path, *arguments: str, authority: Path | None = None) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{free.getsockname()[1]}"
        self.log = folder / "serve.log"
        self.serve = [PROGRAM, "serve", "--listen", self.address, *arguments]
        if authority is None:
            self.uri = f"grpc://{self.address}"
            self.health = [PROGRAM, "health", f"http://{self.address}"]
        else:
            self.uri = f"grpcs://{self.address}"
            self.health = [PROGRAM, "health", f"https://{self.address}", "--tls-ca", str(authority)]
        self.start()

    def start(self) -> None:
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(self.serve, stdout=log, stderr=log)
        while subprocess.run(self.health, capture_output=True).returncode != 0:
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
