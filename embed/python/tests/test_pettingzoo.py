"""The environment of PettingZoo."""

from __future__ import annotations

import numpy as np
import pytest

import surefoot

pytest.importorskip("pettingzoo")
from pettingzoo.test import parallel_api_test, parallel_seed_test  # noqa: E402


def make() -> surefoot.ParallelEnv:
    return surefoot.ParallelEnv(5, {"seed": 3, "size": 60, "kind": "islands"}, goal_distance=(2, 6))


def test_pettingzoo_accepts_the_environment() -> None:
    parallel_api_test(make(), num_cycles=400)


def test_pettingzoo_finds_that_seeds_count() -> None:
    parallel_seed_test(make, num_cycles=100)


def test_agents_leave_when_their_episodes_end_and_the_others_go_on() -> None:
    env = make()
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    counts = []
    while env.agents:
        actions = {agent: rng.uniform(-1, 1, 4).astype(np.float32) for agent in env.agents}
        before = list(env.agents)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        assert list(observations) == list(rewards) == before
        for agent in before:
            assert not (terminated[agent] and truncated[agent])
            ended = terminated[agent] or truncated[agent]
            assert ended == ("outcome" in infos[agent]) == (agent not in env.agents)
        counts.append(len(env.agents))
    assert counts == sorted(counts, reverse=True)
    assert env.step({}) == ({}, {}, {}, {}, {})


def test_an_action_for_every_agent_is_needed() -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(ValueError, match="none for npc_0"):
        env.step({})
    with pytest.raises(ValueError, match="npc_0 has the shape"):
        env.step({agent: np.zeros(3, np.float32) for agent in env.agents})
