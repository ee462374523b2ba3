"""Pictures of environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import surefoot

NPC = ROUTE = (255, 255, 255)
GOAL = (255, 40, 40)


def at(frame: Any, place: Any) -> tuple[int, ...]:
    """The colour of a place on a level of 60 m."""
    x, _, z = place * 480 / 60
    return tuple(int(channel) for channel in frame[int(z), int(x)])


def test_a_picture_shows_the_level_the_npc_and_its_goal(level: surefoot.Level) -> None:
    env = gymnasium.make("surefoot/PointGoal-v0", level=level, render_mode="rgb_array").unwrapped
    assert isinstance(env, surefoot.PointGoalEnv)
    assert env.metadata["render_modes"] == ["rgb_array"] and env.metadata["render_fps"] == 6
    env.reset(seed=1)
    first = env.render()
    assert first is not None and first.shape == (480, 480, 3) and first.dtype == np.uint8
    drawn = (first != level.pixels(pixels_per_m=8.0)).any(axis=2).sum()
    assert 100 < drawn < 300, "two discs"
    for _ in range(12):
        env.step(np.array([1, 0, 0, 0], np.float32))
    later = env.render()
    assert later is not None and not np.array_equal(later, first)
    for frame in (first, later):
        assert at(frame, env.goal()) == GOAL
    assert at(later, env.position()) == NPC


def test_each_environment_has_a_picture_of_its_own_level_and_route(
    level: surefoot.Level, islands: surefoot.Level
) -> None:
    envs = surefoot.VectorEnv(
        3, [level, islands], worlds=2, autoreset_mode=AutoresetMode.DISABLED, render_mode="rgb_array"
    )
    envs.reset(seed=2)
    plain = envs.render()
    assert plain is not None and len(plain) == 3
    for frame, own in zip(plain, [level, level, islands], strict=True):
        assert (frame != own.pixels(pixels_per_m=8.0)).any(axis=2).sum() < 300
    start, end = envs.positions()[0], np.array([55, 0, 55] if envs.positions()[0][0] < 30 else [5, 0, 5], np.float32)
    envs.redirect(0, [end])
    with_route = envs.render()
    assert with_route is not None
    assert at(with_route[0], (start + end) / 2) == ROUTE != at(plain[0], (start + end) / 2)
    np.testing.assert_array_equal(with_route[1], plain[1])
    envs.reset(options={"reset_mask": np.array([True, False, False])})
    without = envs.render()
    assert without is not None and at(without[0], (start + end) / 2) == at(plain[0], (start + end) / 2)


def test_without_a_render_mode_there_are_no_pictures(level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(2, level)
    envs.reset(seed=1)
    assert envs.render() is None and surefoot.PointGoalEnv(level).render() is None


def test_agents_of_a_world_share_a_picture(level: surefoot.Level) -> None:
    pytest.importorskip("pettingzoo")
    env = surefoot.ParallelEnv(4, level, goal_distance=(10, 25), render_mode="rgb_array")
    env.reset(seed=1)
    frame = env.render()
    assert frame is not None
    assert all(at(frame, place) == NPC for place in env.positions())
