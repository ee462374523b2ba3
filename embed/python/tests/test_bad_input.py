"""Bad input gets an exception that says what to change, and nothing else happens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded

import surefoot

SMALL = {"seed": 7, "size": 60}


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"num_envs": 70_000}, "num_envs is 70000, but must be 1 to 65536"),
        ({"num_envs": True}, "num_envs is True"),
        ({"level": {"seed": 1, "size": 10}}, "size.width is 10, but must be 50 to 1000"),
        ({"level": {"seed": 1, "kind": "moon"}}, "no kind `moon`; there are terrain"),
        ({"level": {"seed": 1, "features": {"cheese": 1.0}}}, "no feature `cheese`"),
        ({"level": {"seed": 1, "movers": "doors=9"}}, "doors is 9, but must be 0 to 4"),
        ({"level": {"size": 60}}, "level has no seed"),
        ({"level": []}, "level is empty"),
        ({"body": "giraffe"}, "no body `giraffe`: there are surefoot"),
        ({"body": {"height": 40.0}}, "body.height is 40, but must be"),
        ({"body": {"wings": 2}}, "unknown field `wings`"),
        ({"goal_distance": (9, 3)}, "goal_distance is"),
        ({"goal_distance": 7}, "goal_distance is 7"),
        ({"goal_distance": (0, float("nan"))}, "goal_distance is"),
        ({"worlds": 9}, "worlds is 9, but must be 1 to 4"),
        ({"threads": 0}, "threads is 0"),
        ({"threads": 2**40}, "must be 1 to 1024"),
        ({"render_mode": "human"}, "render_mode is 'human', but must be 'rgb_array'"),
        ({"seed": -1}, "seed is -1"),
        ({"autoreset_mode": "Never"}, "Never"),
    ],
)
def test_wrong_arguments_are_named(wrong: dict[str, Any], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        surefoot.VectorEnv(**{"num_envs": 4, "level": SMALL, **wrong})


def bad_actions() -> list[tuple[Any, str]]:
    nan = np.zeros((4, 4), np.float32)
    nan[2, 1] = np.nan
    return [
        (nan, r"actions\[2, 1\] is NaN, but must be a finite number"),
        (np.full((4, 4), np.inf), r"actions\[0, 0\] is inf"),
        (np.zeros((3, 4)), r"actions has the shape \[3, 4\], but must have \[4, 4\]"),
        (np.zeros(16), "actions has the shape"),
        ("forward", "could not convert"),
    ]


@pytest.mark.parametrize(("actions", "match"), bad_actions())
def test_wrong_actions_change_nothing(actions: Any, match: str) -> None:
    envs, twin = (surefoot.VectorEnv(4, SMALL) for _ in range(2))
    envs.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises(ValueError, match=match):
        envs.step(actions)
    good = np.ones((4, 4), np.float32)
    for mine, theirs in zip(envs.step(good)[:4], twin.step(good)[:4], strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_actions_out_of_range_are_clamped() -> None:
    envs, twin = (surefoot.VectorEnv(4, SMALL) for _ in range(2))
    envs.reset(seed=1)
    twin.reset(seed=1)
    np.testing.assert_array_equal(envs.step(np.full((4, 4), 7.0))[0], twin.step(np.ones((4, 4)))[0])


def test_a_step_needs_a_reset() -> None:
    with pytest.raises(ResetNeeded, match="call reset"):
        surefoot.VectorEnv(1, SMALL).step(np.zeros((1, 4)))
    with pytest.raises(ResetNeeded, match="call reset"):
        surefoot.PointGoalEnv(SMALL).step(np.zeros(4))


def test_closed_environments_stay_closed() -> None:
    envs = surefoot.VectorEnv(1, SMALL)
    envs.close()
    envs.close()
    with pytest.raises(ClosedEnvironmentError, match="make new ones"):
        envs.reset()


@pytest.mark.parametrize("mask", [np.zeros(4, np.bool_), np.ones(3, np.bool_), [True] * 4, np.ones(4)])
def test_wrong_masks_are_refused(mask: Any) -> None:
    envs = surefoot.VectorEnv(4, SMALL)
    envs.reset()
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": mask})


@pytest.mark.parametrize(
    ("seed", "match"),
    [
        ([1, 2, 3], "seed has 3 values, but there are 2 environments"),
        ([1, -1], "seed is -1, but must be a whole number"),
        ([1, 2.5], "seed is 2.5, but must be a whole number"),
        (2.5, "seed is 2.5, but must be a whole number"),
    ],
)
def test_wrong_seeds_are_refused(seed: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        surefoot.VectorEnv(2, SMALL).reset(seed=seed)


@pytest.mark.parametrize(
    "read", [surefoot.Level.load, surefoot.Graph.load, surefoot.Policy.load], ids=["level", "graph", "policy"]
)
def test_files_that_do_not_exist_are_not_found(read: Callable[[Path], object], tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="missing"):
        read(tmp_path / "missing.x")


def test_damaged_files_are_told_from_sound_ones(level: surefoot.Level, tmp_path: Path) -> None:
    whole = level.to_bytes()
    (tmp_path / "cut.sfmap").write_bytes(whole[:-100])
    with pytest.raises(ValueError, match=r"cut\.sfmap: the saved map is cut off"):
        surefoot.Level.load(tmp_path / "cut.sfmap")
    damaged = bytearray(whole)
    damaged[len(damaged) // 2] ^= 1
    with pytest.raises(ValueError, match="damaged"):
        surefoot.Level.from_bytes(bytes(damaged))
    (tmp_path / "level.glb").write_bytes(b"glTF" + bytes(3))
    with pytest.raises(ValueError, match=r"level\.glb"):
        surefoot.Level.load(tmp_path / "level.glb")
    (tmp_path / "graph.json").write_text('{"nodes": [')
    with pytest.raises(ValueError, match=r"graph\.json"):
        surefoot.Graph.load(tmp_path / "graph.json")


def test_a_level_without_ground_is_refused(tmp_path: Path) -> None:
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 2 3 4\n")
    with pytest.raises(ValueError):
        surefoot.VectorEnv(1, tmp_path / "wall.obj")


def test_nobody_answers_at_a_wrong_address() -> None:
    with pytest.raises(ConnectionError, match="cannot reach"):
        surefoot.connect("grpc://127.0.0.1:1")
    with pytest.raises(ValueError, match="is not a URI"):
        surefoot.connect("grpc:// ")
    with pytest.raises(ValueError, match="must be given together"):
        surefoot.connect("grpc://127.0.0.1:1", tls_client_cert="cert.pem")
