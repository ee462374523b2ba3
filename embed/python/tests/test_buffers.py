"""Environments in the caller's arrays."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import surefoot


def buffers(count: int) -> dict[str, np.ndarray]:
    return {
        "observations": np.zeros((count, 369), np.float32),
        "actions": np.zeros((count, 4), np.float32),
        "rewards": np.zeros(count, np.float32),
        "terminals": np.zeros(count, np.bool_),
        "truncations": np.zeros(count, np.bool_),
        "masks": np.zeros(count, np.bool_),
    }


def test_results_are_written_in_place_and_equal_those_of_the_vector_environment(islands: surefoot.Level) -> None:
    # A slice of shared memory, as PufferLib has it.
    whole = buffers(24)
    mine = {name: array[8:16] for name, array in whole.items()}
    env = surefoot.BufferEnv(8, islands, buf=mine, goal_distance=(2, 8), log_interval=1)
    same = surefoot.VectorEnv(8, islands, goal_distance=(2, 8), autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=4)
    np.testing.assert_array_equal(whole["observations"][8:16], same.reset(seed=4)[0])
    told = []
    for action in np.random.default_rng(0).uniform(-1, 1, (120, 8, 4)).astype(np.float32):
        mine["actions"][:] = action
        observations, *_, infos = env.step(mine["actions"])
        assert observations is mine["observations"]
        wanted = same.step(action)
        for name, values in zip(("observations", "rewards", "terminals", "truncations"), wanted, strict=False):
            np.testing.assert_array_equal(whole[name][8:16], values)
            assert not whole[name][:8].any() and not whole[name][16:].any()
        told += infos
    assert mine["masks"].all()
    assert sum(info["n"] for info in told) > 5


def test_arrays_are_made_if_none_are_given(level: surefoot.Level) -> None:
    env = surefoot.BufferEnv(3, level)
    env.async_reset(seed=1)
    assert env.recv()[0].shape == (3, 369)
    env.send(np.zeros((3, 4), np.float32))
    observations, rewards, terminals, truncations, _, ids, masks = env.recv()
    assert observations.shape == (3, 369) and rewards.dtype == np.float32
    assert not terminals.any() and not truncations.any() and list(ids) == [0, 1, 2] and masks.all()


@pytest.mark.parametrize(
    "wrong",
    [np.zeros((8, 369), np.float64), np.zeros((8, 368), np.float32), np.zeros((369, 8), np.float32).T, [0.0]],
)
def test_unfit_arrays_are_refused(wrong: object, level: surefoot.Level) -> None:
    with pytest.raises(ValueError, match=r"buf\['observations'\]"):
        surefoot.BufferEnv(8, level, buf={**buffers(8), "observations": wrong})
