"""Environments that write into the caller's arrays, as PufferLib requires."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from ._native import Server
from ._setup import (
    BodyLike,
    Flags,
    Floats,
    LevelLike,
    Setup,
    action_space,
    body_text,
    distances,
    fresh_seed,
    levels_of,
    observation_space,
    server_of,
    thread_count,
    whole,
)


class BufferEnv:
    """Environments that read and write arrays of the caller, such as shared memory.

    A step reads `actions` and writes the others in place; it copies nothing, and allocates nothing unless an episode
    ends. An environment is reset in the step that ends its episode. It has the attributes and methods of PufferLib's
    `PufferEnv`, which need not be installed; PufferLib's own vectorisation needs a subclass of both:
    `class Env(surefoot.BufferEnv, pufferlib.PufferEnv): pass`.

    Args:
        num_agents: Number of environments.
        buf: Arrays `observations` (n, 369 or 461; float32), `actions` (n, 4; float32), `rewards` (n; float32),
            `terminals` and `truncations` (n; bool), each contiguous; they are made if it is left out.
        log_interval: A step returns one info with the share of each outcome after this many steps in which episodes
            ended.

    All others are those of `VectorEnv`.
    """

    def __init__(
        self,
        num_agents: int = 1024,
        level: LevelLike | Sequence[LevelLike] = 0,
        *,
        buf: Mapping[str, Any] | None = None,
        body: BodyLike = "surefoot",
        others: bool = False,
        goal_distance: Sequence[float] = (5.0, 25.0),
        seed: int | None = None,
        worlds: int | None = None,
        threads: int | None = None,
        server: Server | str | None = None,
        log_interval: int = 128,
    ) -> None:
        self.num_agents = whole("num_agents", num_agents)
        self.agents_per_batch = self.num_agents
        self.agent_ids = np.arange(self.num_agents)
        self.single_observation_space = observation_space(others)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_agents)
        self.action_space = batch_space(self.single_action_space, self.num_agents)
        levels = levels_of(level)
        setup = Setup(
            levels=tuple(levels),
            body=body_text(body),
            others=others,
            num_envs=self.num_agents,
            worlds=len(levels) if worlds is None else whole("worlds", worlds),
            goal_distance=distances(goal_distance),
            autoreset=AutoresetMode.SAME_STEP.value,
            threads=thread_count(threads),
            server=server_of(server),
        )
        buf = {} if buf is None else buf
        length = self.single_observation_space.shape[0]
        self.observations: Floats = self._array(buf, "observations", (self.num_agents, length), np.float32)
        self.actions: Floats = self._array(buf, "actions", (self.num_agents, 4), np.float32)
        self.rewards: Floats = self._array(buf, "rewards", (self.num_agents,), np.float32)
        self.terminals: Flags = self._array(buf, "terminals", (self.num_agents,), np.bool_)
        self.truncations: Flags = self._array(buf, "truncations", (self.num_agents,), np.bool_)
        self.masks: Flags = self._array(buf, "masks", (self.num_agents,), np.bool_)
        self.masks[:] = True
        self._worlds = setup.open(fresh_seed() if seed is None else seed)
        self._log_interval = whole("log_interval", log_interval)
        self._outcomes: dict[str, int] = {}
        self._steps = 0
        self.infos: list[dict[str, Any]] = []

    @staticmethod
    def _array(buf: Mapping[str, Any], name: str, shape: tuple[int, ...], dtype: type[Any]) -> Any:
        array = buf.get(name)
        if array is None:
            return np.zeros(shape, dtype)
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
            raise ValueError(f"buf['{name}'] must be a numpy array of the shape {shape} and type {np.dtype(dtype)}")
        if not array.flags.c_contiguous or not array.flags.writeable:
            raise ValueError(f"buf['{name}'] must be contiguous and writable")
        return array

    @property
    def driver_env(self) -> BufferEnv:
        """The environment itself."""
        return self

    @property
    def emulated(self) -> bool:
        """False: nothing is converted."""
        return False

    @property
    def done(self) -> bool:
        """False: the environments never finish."""
        return False

    def reset(self, seed: int | None = None) -> tuple[Floats, list[dict[str, Any]]]:
        """Starts new episodes, and writes their first observations into `observations`."""
        if seed is None:
            self._worlds.renew(np.ones(self.num_agents, np.bool_), self.observations)
        else:
            self._worlds.reseed(int(seed), self.observations)
        self.rewards[:] = 0.0
        self.terminals[:] = False
        self.truncations[:] = False
        return self.observations, []

    def step(self, actions: Any = None) -> tuple[Floats, Floats, Flags, Flags, list[dict[str, Any]]]:
        """Runs one decision of every environment with `actions`, or with the content of the array of actions."""
        if actions is not None and actions is not self.actions:
            self.actions[:] = actions
        ends = self._worlds.step(self.actions, self.observations, self.rewards, self.terminals, self.truncations)
        infos: list[dict[str, Any]] = []
        if ends is not None:
            for outcome in ends[1]:
                self._outcomes[outcome] = self._outcomes.get(outcome, 0) + 1
            self._steps += 1
            if self._steps % self._log_interval == 0:
                count = sum(self._outcomes.values())
                infos.append({**{name: each / count for name, each in self._outcomes.items()}, "n": count})
                self._outcomes.clear()
        return self.observations, self.rewards, self.terminals, self.truncations, infos

    def async_reset(self, seed: int | None = None) -> None:
        """Resets; `recv` returns the results."""
        _, self.infos = self.reset(seed)

    def send(self, actions: Any) -> None:
        """Steps; `recv` returns the results."""
        self.infos = self.step(actions)[4]

    def recv(self) -> tuple[Any, ...]:
        """The results of the last `async_reset` or `send`, with the ids of the agents and their masks."""
        return (
            self.observations,
            self.rewards,
            self.terminals,
            self.truncations,
            self.infos,
            self.agent_ids,
            self.masks,
        )

    def close(self) -> None:
        """Ends the environments, here or on the server."""
        self.__dict__.pop("_worlds", None)
