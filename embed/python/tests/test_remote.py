"""The same environments on a server."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Process
from gymnasium.vector import AutoresetMode
from test_gymnasium import assert_same, play

import surefoot


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
@pytest.mark.parametrize("others", [False, True])
def test_a_server_gives_the_same_bits(mode: AutoresetMode, others: bool, islands: surefoot.Level, server: Process) -> None:
    arguments: dict[str, Any] = {"goal_distance": (2, 8), "others": others, "worlds": 2, "autoreset_mode": mode}
    here = play(surefoot.VectorEnv(12, islands, **arguments), 120)
    there = play(surefoot.VectorEnv(12, islands, server=server.uri, **arguments), 120)
    assert_same(here, there)
    assert sum(int((step[2] | step[3]).sum()) for step in there[1:]) > 10, "episodes end"
    for mine, theirs in zip(here[1:], there[1:], strict=True):
        assert mine[4].keys() == theirs[4].keys()


def test_seeds_of_environments_mean_the_same_there(islands: surefoot.Level, server: Process) -> None:
    here, there = (
        surefoot.VectorEnv(5, islands, goal_distance=(2, 8), worlds=2, server=it) for it in (None, server.uri)
    )
    seeds = [4, 9, 4, 1, 2]
    np.testing.assert_array_equal(here.reset(seed=seeds)[0], there.reset(seed=seeds)[0])
    ends = 0
    for action in np.random.default_rng(2).uniform(-1, 1, (120, 5, 4)).astype(np.float32):
        mine, theirs = here.step(action), there.step(action)
        np.testing.assert_array_equal(mine[0], theirs[0])
        ends += int((mine[2] | mine[3]).sum())
    assert ends > 3, "episodes end"


def test_levels_of_files_are_sent_to_the_server(level: surefoot.Level, server: Process, tmp_path: Path) -> None:
    level.save(tmp_path / "level.sfmap")
    box = "".join(f"v {x} {y} {z}\n" for x in (0, 40) for y in (0, 1) for z in (0, 40))
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (tmp_path / "floor.obj").write_text(box + faces)
    arguments: dict[str, Any] = {"goal_distance": (2, 8), "worlds": 2}
    levels = [tmp_path / "level.sfmap", tmp_path / "floor.obj"]
    assert_same(
        play(surefoot.VectorEnv(6, levels, **arguments), 20),
        play(surefoot.VectorEnv(6, levels, server=server.uri, **arguments), 20),
    )


def test_other_kinds_of_environments_run_there_too(islands: surefoot.Level, server: Process) -> None:
    there = surefoot.connect(server.uri)
    assert repr(there).startswith("<Server http://")
    assert surefoot.PointGoalEnv(islands, server=there).reset(seed=1)[0].shape == (369,)
    assert surefoot.BufferEnv(4, islands, server=there).observations.shape == (4, 369)
    pairs = [surefoot.ParallelEnv(3, islands, goal_distance=(2, 8), server=it) for it in (None, there)]
    for env in pairs:
        env.reset(seed=2)
    rng = np.random.default_rng(1)
    while pairs[0].agents:
        actions = {agent: rng.uniform(-1, 1, 4).astype(np.float32) for agent in pairs[0].agents}
        mine, theirs = (env.step(actions) for env in pairs)
        assert mine[1:] == theirs[1:]
        for agent in mine[0]:
            np.testing.assert_array_equal(mine[0][agent], theirs[0][agent])
    assert pairs[1].agents == []


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_a_lost_server_truncates_what_ran_and_says_so(mode: AutoresetMode, islands: surefoot.Level, tmp_path: Path) -> None:
    server = Process(tmp_path)
    try:
        envs = surefoot.VectorEnv(4, islands, server=server.uri, autoreset_mode=mode)
        last, _ = envs.reset(seed=1)
        still = np.zeros((4, 4), np.float32)
        for _ in range(3):
            last, _, terminated, truncated, infos = envs.step(still)
            assert not terminated.any() and not truncated.any() and not infos
        server.stop()
        server.start()
        observations, rewards, terminated, truncated, infos = envs.step(still)
        assert truncated.all() and not terminated.any() and (rewards == 0).all()
        told = infos["final_info"] if mode is AutoresetMode.SAME_STEP else infos
        assert list(told["outcome"]) == ["lost"] * 4
        if mode is AutoresetMode.SAME_STEP:
            np.testing.assert_array_equal(np.stack(infos["final_obs"]), last)
            assert not np.array_equal(observations, last)
        else:
            np.testing.assert_array_equal(observations, last)
        if mode is AutoresetMode.DISABLED:
            observations, _ = envs.reset()
        _, rewards, terminated, truncated, infos = envs.step(still)
        assert not (terminated | truncated).any() and not infos
        for _ in range(5):
            assert np.isfinite(envs.step(still)[0]).all()
    finally:
        server.stop()


def test_a_server_that_stays_away_is_an_error_and_can_come_back(islands: surefoot.Level, tmp_path: Path) -> None:
    server = Process(tmp_path)
    try:
        envs = surefoot.VectorEnv(2, islands, server=surefoot.connect(server.uri, patience=0.3))
        envs.reset(seed=1)
        server.stop()
        for _ in range(2):
            with pytest.raises(ConnectionError):
                envs.step(np.zeros((2, 4)))
        server.start()
        assert list(envs.step(np.zeros((2, 4)))[4]["outcome"]) == ["lost"] * 2
    finally:
        server.stop()


def test_what_a_server_cannot_do_is_said(islands: surefoot.Level, server: Process) -> None:
    envs = surefoot.VectorEnv(2, islands, server=server.uri, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=1)
    with pytest.raises(ValueError, match="resets all environments or none"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(NotImplementedError, match="leave the server out"):
        envs.redirect(0, [(1, 1, 1)])
    with pytest.raises(ValueError, match=r"actions\[0, 0\] is NaN"):
        envs.step(np.full((2, 4), np.nan))
    with pytest.raises(ValueError, match="threads applies to"):
        surefoot.VectorEnv(4, islands, worlds=2, threads=2, server=server.uri)
    with pytest.raises(ValueError, match="refused"):
        surefoot.VectorEnv(5000, islands, server=server.uri)
    with pytest.raises(ValueError, match="give one, or use NEXT_STEP"):
        same_step = surefoot.VectorEnv(2, islands, server=server.uri, autoreset_mode=AutoresetMode.SAME_STEP)
        same_step.reset(seed=[1, 2])
    with pytest.raises(TypeError, match="call connect in the other process"):
        pickle.dumps(surefoot.connect(server.uri))
