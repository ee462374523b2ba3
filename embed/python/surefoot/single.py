"""One environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from ._frames import RENDER_FPS, RENDER_MODES, Frame, checked_mode
from ._native import Server
from ._setup import BodyLike, Floats, LevelLike
from .vector import VectorEnv


class PointGoalEnv(gymnasium.Env[Floats, Floats]):
    """One NPC that must reach goals on a level: `gymnasium.make("surefoot/PointGoal-v0")`.

    The arguments are those of `VectorEnv` that apply to one environment. Many environments together are several times
    as fast.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}

    def __init__(
        self,
        level: LevelLike | Sequence[LevelLike] = 0,
        *,
        body: BodyLike = "surefoot",
        goal_distance: Sequence[float] = (5.0, 25.0),
        seed: int | None = None,
        server: Server | str | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = checked_mode(render_mode)
        self._env = VectorEnv(
            1,
            level,
            body=body,
            goal_distance=goal_distance,
            seed=seed,
            autoreset_mode=AutoresetMode.DISABLED,
            copy=False,
            server=server,
            render_mode=render_mode,
        )
        self.observation_space = self._env.single_observation_space
        self.action_space = self._env.single_action_space
        self._has_episode = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Starts an episode."""
        super().reset(seed=seed)
        observations, _ = self._env.reset(seed=seed)
        self._has_episode = True
        return observations[0].copy(), {}

    def step(self, action: npt.ArrayLike) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Runs one decision. `info["outcome"]` says how the episode ended, if it did."""
        if not self._has_episode:
            raise ResetNeeded("the episode has ended, or none was begun: call reset")
        values = np.asarray(action, np.float32)
        if values.shape != self.action_space.shape:
            raise ValueError(f"action has the shape {values.shape}, but must have {self.action_space.shape}")
        observations, rewards, terminated, truncated, infos = self._env.step(values[None])
        info = {"outcome": infos["outcome"][0]} if infos else {}
        self._has_episode = not infos
        return observations[0].copy(), float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Frame | None:
        """With `render_mode="rgb_array"`, a picture as `VectorEnv.render` makes it."""
        frames = self._env.render()
        return None if frames is None else frames[0]

    def position(self) -> Floats:
        """Feet of the NPC, m."""
        return np.asarray(self._env.positions()[0], np.float32)

    def goal(self) -> Floats:
        """Where the NPC must go, m."""
        return np.asarray(self._env.goals()[0], np.float32)

    def close(self) -> None:
        """Ends the environment."""
        self._env.close()
