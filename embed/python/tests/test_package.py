"""The installed package: its licences, and generated gRPC stubs beside it. SUREFOOT_STUBS names their folder."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Process

import surefoot

IMPORT = """
import json, sys
import grpc, surefoot
from surefoot.planner.v1 import planner_pb2_grpc
from surefoot.world.v1 import maps_pb2, maps_pb2_grpc

maps = maps_pb2_grpc.MapServiceStub(grpc.insecure_channel(sys.argv[1]))
request = maps_pb2.ImportMapRequest(name="floor", format=maps_pb2.MAP_FORMAT_OBJ, file=open(sys.argv[2], "rb").read())
answer = maps.ImportMap(request)
level = surefoot.Level.load(sys.argv[2])
print(json.dumps([[answer.origin.x, answer.origin.y, answer.origin.z], level.origin]))
"""


def test_licences_and_notices_come_with_the_package() -> None:
    files = importlib.metadata.files("surefoot") or []
    texts = {file.name: file.read_text(encoding="utf-8") for file in files if "licenses" in file.parts}
    assert texts.keys() == {"LICENSE-APACHE", "LICENSE-MIT", "THIRD_PARTY_NOTICES.md"}
    assert "MIT License" in texts["LICENSE-MIT"] and "- pyo3 " in texts["THIRD_PARTY_NOTICES.md"]
    named = importlib.metadata.metadata("surefoot").get_all("License-File")
    assert named is not None and set(named) == set(texts)


@pytest.mark.skipif("SUREFOOT_STUBS" not in os.environ, reason="there are no generated stubs")
def test_generated_stubs_work_beside_the_package_and_agree_about_the_origin(server: Process, tmp_path: Path) -> None:
    corners = [(0.25, 0.5), (40.25, 0.5), (40.25, 40.5), (0.25, 40.5)]
    floor = tmp_path / "floor.obj"
    vertices = "".join(f"v {4_000_000 + x} 12.125 {z - 3_000_000}\n" for x, z in corners)
    floor.write_text(vertices + "f 4 3 2 1\n")
    paths = os.pathsep.join([os.environ["SUREFOOT_STUBS"], os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", IMPORT, server.address, str(floor)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stderr
    theirs, ours = json.loads(done.stdout)
    assert theirs == ours == list(surefoot.Level.load(floor).origin)
    assert ours[0] < -3_900_000, "the level lies far from its origin"
