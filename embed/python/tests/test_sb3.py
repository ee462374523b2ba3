"""The vector environment of Stable-Baselines3."""

from __future__ import annotations

import numpy as np
import pytest

import surefoot

pytest.importorskip("stable_baselines3")
from surefoot.sb3 import SB3VecEnv  # noqa: E402


def test_observations_outlive_the_next_step_and_ends_are_told(islands: surefoot.Level) -> None:
    envs = SB3VecEnv(6, islands, goal_distance=(2, 8))
    envs.seed(3)
    last = envs.reset()
    ends = 0
    for action in np.random.default_rng(0).uniform(-1, 1, (120, 6, 4)).astype(np.float32):
        kept = last.copy()
        observations, rewards, dones, infos = envs.step(action)
        np.testing.assert_array_equal(last, kept)
        for done, info in zip(dones, infos, strict=True):
            assert done == ("terminal_observation" in info) == ("outcome" in info)
            if done:
                ends += 1
                assert info["TimeLimit.truncated"] == (info["outcome"] == "no_progress")
                assert info["episode"]["l"] > 0
        last = observations
    assert ends > 5


def test_what_stable_baselines_needs_cannot_be_changed(islands: surefoot.Level) -> None:
    with pytest.raises(ValueError, match="leave copy out"):
        SB3VecEnv(2, islands, copy=False)
