"""The vector environment of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from .vector import VectorEnv


class SB3VecEnv(VecEnv):
    """A `VectorEnv` for Stable-Baselines3, which resets environments in the step that ends their episodes.

    The arguments are those of `VectorEnv` except `autoreset_mode` and `copy`. `infos[i]["outcome"]` says how an episode
    ended.
    """

    def __init__(self, num_envs: int = 1, level: Any = 0, **arguments: Any) -> None:
        # Stable-Baselines3 keeps the observations of a step until the next step is done.
        for fixed in ("autoreset_mode", "copy"):
            if fixed in arguments:
                raise ValueError(f"leave {fixed} out: Stable-Baselines3 needs SAME_STEP and arrays of its own")
        self.envs = VectorEnv(num_envs, level, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, np.int64)

    def reset(self) -> Any:
        """Starts new episodes."""
        seed = self._seeds[0]
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return self.envs.reset(seed=seed)[0]

    def step_async(self, actions: npt.NDArray[np.float32]) -> None:
        """Stores the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Runs the step."""
        observations, rewards, terminated, truncated, told = self.envs.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if told:
            for index in np.flatnonzero(told["_final_obs"]):
                infos[index] = {
                    "terminal_observation": told["final_obs"][index],
                    "outcome": told["final_info"]["outcome"][index],
                    "TimeLimit.truncated": bool(truncated[index]),
                    "episode": {"r": float(self._returns[index]), "l": int(self._lengths[index])},
                }
                self._returns[index] = self._lengths[index] = 0
        return observations, rewards, terminated | truncated, infos

    def close(self) -> None:
        """Ends the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, which all environments share."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Environments have no attributes of their own."""
        raise AttributeError(f"{attr_name} cannot be set: environments have no attributes of their own")

    def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **named: Any) -> list[Any]:
        """Environments have no methods of their own."""
        raise AttributeError(f"{method_name} cannot be called: environments have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Pictures with `render_mode="rgb_array"`."""
        return self.envs.render() or [None] * self.num_envs


__all__ = ["SB3VecEnv"]
