"""Several NPCs in one world as an environment of PettingZoo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from pettingzoo import ParallelEnv as _ParallelEnv

from ._frames import RENDER_FPS, RENDER_MODES, Frame, checked_mode
from ._native import Server
from ._setup import BodyLike, Flags, Floats, LevelLike, action_space, observation_space
from .vector import VectorEnv


class ParallelEnv(_ParallelEnv[str, Floats, Floats]):  # type: ignore[misc]
    """NPCs that share a world, `npc_0`, `npc_1` and so on, each with its own goal.

    The arguments are those of `VectorEnv`. By default NPCs collide with each other. An NPC whose episode has ended
    stays where it is until `reset`.
    """

    metadata: dict[str, Any] = {
        "name": "surefoot_point_goal_v0",
        "render_modes": RENDER_MODES,
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        num_agents: int = 8,
        level: LevelLike = 0,
        *,
        body: BodyLike = "surefoot",
        others: bool = True,
        goal_distance: tuple[float, float] = (5.0, 25.0),
        seed: int | None = None,
        server: Server | str | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = checked_mode(render_mode)
        self._env = _Crowd(
            num_agents,
            level,
            body=body,
            others=others,
            goal_distance=goal_distance,
            seed=seed,
            autoreset_mode=AutoresetMode.DISABLED,
            copy=False,
            server=server,
        )
        self.possible_agents = [f"npc_{index}" for index in range(num_agents)]
        self.agents: list[str] = []
        self._index = {agent: index for index, agent in enumerate(self.possible_agents)}
        self.observation_spaces = {agent: observation_space(others) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space() for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Box:
        """Space of an agent's observations, the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Space of an agent's actions, the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Floats], dict[str, dict[str, Any]]]:
        """Starts an episode of every agent."""
        observations, _ = self._env.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self._rows(observations), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, Floats]
    ) -> tuple[
        dict[str, Floats], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Runs one decision of all remaining agents."""
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"actions has none for {missing[0]}: give one for every agent in agents")
        values = np.zeros((len(self.possible_agents), 4), np.float32)
        for agent in self.agents:
            action = np.asarray(actions[agent], np.float32)
            if action.shape != (4,):
                raise ValueError(f"the action of {agent} has the shape {action.shape}, but must have (4,)")
            values[self._index[agent]] = action
        observations, rewards, terminated, truncated, infos = self._env.step(values)
        outcomes = infos.get("outcome")
        told: dict[str, dict[str, Any]] = {agent: {} for agent in self.agents}
        rows = self._rows(observations)
        left = []
        for agent in self.agents:
            index = self._index[agent]
            if terminated[index] or truncated[index]:
                told[agent]["outcome"] = outcomes[index] if outcomes is not None else None
            else:
                left.append(agent)
        answer = (
            rows,
            {agent: float(rewards[self._index[agent]]) for agent in self.agents},
            {agent: bool(terminated[self._index[agent]]) for agent in self.agents},
            {agent: bool(truncated[self._index[agent]]) for agent in self.agents},
            told,
        )
        self.agents = left
        return answer

    def _rows(self, observations: Floats) -> dict[str, Floats]:
        return {agent: observations[self._index[agent]].copy() for agent in self.agents}

    def state(self) -> Floats:
        """The observations of all agents in order."""
        return self._env._observations.ravel().copy()

    def positions(self) -> Floats:
        """Feet of the NPCs, m."""
        return self._env.positions()

    def goals(self) -> Floats:
        """Where the NPCs must go, m."""
        return self._env.goals()

    def render(self) -> Frame | None:
        """With `render_mode="rgb_array"`, a picture of all NPCs and goals, as `VectorEnv.render` makes it."""
        if self.render_mode is None:
            return None
        return next(self._env._frames([range(len(self.possible_agents))]))

    def close(self) -> None:
        """Ends the environment."""
        self._env.close()


class _Crowd(VectorEnv):
    """Environments that can be stepped while some of them wait for a reset."""

    def _needs_reset(self) -> Flags:
        return np.zeros(self.num_envs, np.bool_)
