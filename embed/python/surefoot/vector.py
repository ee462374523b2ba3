"""Many environments of this process, or of a server, as one Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as _VectorEnv
from gymnasium.vector.utils import batch_space

from ._frames import RENDER_FPS, RENDER_MODES, Canvas, Frame, checked_mode
from ._native import Level, Server, Worlds
from ._setup import (
    BodyLike,
    Flags,
    Floats,
    LevelLike,
    Setup,
    action_space,
    body_text,
    checked_seed,
    distances,
    fresh_seed,
    levels_of,
    observation_space,
    server_of,
    thread_count,
    whole,
)


class VectorEnv(_VectorEnv[Floats, npt.ArrayLike, npt.NDArray[Any]]):
    """NPCs that must reach goals on a level, one for each environment.

    An action is forward, strafe, turn and jump, each in [-1, 1]; it holds for a decision, a sixth of a second. An
    episode terminates when its NPC reaches the goal, falls out of the level, burns or drowns (`infos["outcome"]` says
    which), and is truncated after 300 decisions without progress.

    Args:
        num_envs: Number of environments, 1 to 65536.
        level: A level, the seed of a generated map, a file, a dict of arguments of `Level.generate`, or several of
            these in a list.
        body: Name of a body (`surefoot.body_names()`), or a dict with the fields of its profile that differ from the
            default.
        others: Whether the NPCs of a world collide with and see each other; observations then have 461 values instead
            of 369.
        goal_distance: Least and greatest distance of goals from starts, m, 0 to 1500.
        seed: Seed of starts and goals until `reset` gets one; random by default.
        worlds: Number of worlds among which the environments are divided; the worlds are on the levels in turn. By
            default one for each level. World k draws its starts and goals with seed + k. Results depend on it.
        threads: Greatest number of threads that step the environments, by default as many as cores. With `others`, or
            on a level with movers, one thread steps a world. Results do not depend on it.
        autoreset_mode: What happens to an environment after its episode has ended.
        copy: Whether `reset` and `step` return arrays of their own; otherwise those that the next call overwrites.
        server: A server that runs the environments instead of this process: its address, or what `surefoot.connect`
            returned. The same arguments give the same bits there. If the connection is lost, the environments are
            created again as soon as the server is back, and the episodes that ran are truncated with the outcome
            "lost".
        render_mode: With `"rgb_array"`, `render` returns pictures.
    """

    metadata: dict[str, Any] = {
        "render_modes": RENDER_MODES,
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        level: LevelLike | Sequence[LevelLike] = 0,
        *,
        body: BodyLike = "surefoot",
        others: bool = False,
        goal_distance: Sequence[float] = (5.0, 25.0),
        seed: int | None = None,
        worlds: int | None = None,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        server: Server | str | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = whole("num_envs", num_envs)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = checked_mode(render_mode)
        self.copy = copy
        levels = levels_of(level)
        self.setup = Setup(
            levels=tuple(levels),
            body=body_text(body),
            others=bool(others),
            num_envs=self.num_envs,
            worlds=len(levels) if worlds is None else whole("worlds", worlds),
            goal_distance=distances(goal_distance),
            autoreset=self.autoreset_mode.value,
            threads=thread_count(threads),
            server=server_of(server),
        )
        self.single_observation_space = observation_space(self.setup.others)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._worlds: Worlds = self.setup.open(fresh_seed() if seed is None else seed)
        self._observations: Floats = np.zeros(self.observation_space.shape or (), np.float32)
        self._rewards: Floats = np.zeros(self.num_envs, np.float32)
        self._terminated: Flags = np.zeros(self.num_envs, np.bool_)
        self._truncated: Flags = np.zeros(self.num_envs, np.bool_)
        self._is_new = True
        self._was_reset = False
        self._canvases: dict[Level, Canvas] = {}
        # Places of the routes that redirect gave.
        self._routes: dict[int, Floats] = {}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Starts new episodes. With `options={"reset_mask": mask}`, only some environments do.

        A list of seeds has one for each environment, which then has the episodes that it would have alone in its world;
        `None` in the list is a random seed.
        """
        self._check_open()
        seeds = _checked_seed(seed)
        mask = None if options is None else options.get("reset_mask")
        if mask is not None:
            self._renew(self._checked(mask), seeds)
        elif seeds is not None:
            if isinstance(seeds, int):
                super().reset(seed=seeds)
            self._worlds.reseed(seeds, self._observations)
        elif self._is_new:
            self._worlds.first_observations(self._observations)
        else:
            self._worlds.renew(np.ones(self.num_envs, np.bool_), self._observations)
        if mask is None:
            self._terminated[:] = False
            self._truncated[:] = False
            self._routes.clear()
        self._is_new = False
        self._was_reset = True
        return self._own(self._observations), {}

    def _checked(self, mask: Any) -> Flags:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must be a numpy array of {self.num_envs} bools")
        if not mask.any():
            raise ValueError("options['reset_mask'] names no environment: set at least one to True")
        return np.ascontiguousarray(mask)

    def _renew(self, mask: Flags, seeds: int | list[int] | None) -> None:
        if seeds is not None:
            raise ValueError("a seed needs a reset of all environments: leave out the seed or the reset_mask")
        if not self._was_reset:
            raise ResetNeeded("reset all environments first")
        self._worlds.renew(mask, self._observations)
        self._terminated[mask] = False
        self._truncated[mask] = False
        for env in np.flatnonzero(mask):
            self._routes.pop(int(env), None)

    def step(self, actions: npt.ArrayLike) -> tuple[Floats, Floats, Flags, Flags, dict[str, Any]]:
        """Runs one decision of every environment."""
        self._check_open()
        if not self._was_reset:
            raise ResetNeeded("call reset before step")
        done = self._needs_reset()
        if done.any():
            raise ResetNeeded(
                f"the episode of environment {done.argmax()} has ended: "
                "reset it with options={'reset_mask': ...} first"
            )
        values = np.ascontiguousarray(actions, dtype=np.float32)
        ends = self._worlds.step(values, self._observations, self._rewards, self._terminated, self._truncated)
        infos = {} if ends is None else self._infos(*ends)
        if ends is not None and self._routes:
            for env in ends[0]:
                self._routes.pop(int(env), None)
        return (
            self._own(self._observations),
            self._own(self._rewards),
            self._terminated.copy() if self.copy else self._terminated,
            self._truncated.copy() if self.copy else self._truncated,
            infos,
        )

    def _check_open(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("these environments are closed: make new ones")

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the environments, here or on the server."""
        # If the constructor failed, there are none.
        self.__dict__.pop("_worlds", None)

    def _needs_reset(self) -> Flags:
        """Environments that must be reset before the next step."""
        if self.autoreset_mode is AutoresetMode.DISABLED:
            return self._terminated | self._truncated
        return np.zeros(self.num_envs, np.bool_)

    def _infos(self, indices: npt.NDArray[np.int64], outcomes: list[str], finals: Floats) -> dict[str, Any]:
        """Information about episodes that ended, in the form of Gymnasium."""
        mask = np.zeros(self.num_envs, np.bool_)
        mask[indices] = True
        names = np.full(self.num_envs, None, dtype=object)
        names[indices] = outcomes
        outcome = {"outcome": names, "_outcome": mask}
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return outcome
        observations = np.full(self.num_envs, None, dtype=object)
        for index, final in zip(indices, finals, strict=True):
            observations[index] = final
        return {
            "final_obs": observations,
            "_final_obs": mask,
            "final_info": outcome,
            "_final_info": mask,
        }

    def _own(self, values: Floats) -> Floats:
        return values.copy() if self.copy else values

    def positions(self) -> Floats:
        """Feet of the NPCs, m: an array of x, y and z for each."""
        return self._worlds.positions()

    def goals(self) -> Floats:
        """Where the NPCs must go, m: an array of x, y and z for each."""
        return self._worlds.goals()

    def render(self) -> tuple[Frame, ...] | None:
        """With `render_mode="rgb_array"`, a picture of each environment: an array (height, width, 3).

        It shows the level from above, x to the right and z downwards, up to 480 pixels wide and high. The NPC is white
        and its goal red; a line is the route that `redirect` gave. A server does not report goals of `SAME_STEP`.
        """
        if self.render_mode is None:
            return None
        return tuple(self._frames([[env] for env in range(self.num_envs)]))

    def _frames(self, groups: Sequence[Sequence[int]]) -> Iterator[Frame]:
        """A picture for each group of environments, which share a world."""
        if not self._was_reset:
            raise ResetNeeded("call reset before render")
        has_goals = self.setup.server is None or self.autoreset_mode is not AutoresetMode.SAME_STEP
        positions, goals = self.positions(), self.goals() if has_goals else np.zeros((self.num_envs, 0, 3), np.float32)
        for group in groups:
            level = self.setup.level_of(group[0])
            if level not in self._canvases:
                self._canvases[level] = Canvas(level)
            routes = [self._routes[env] for env in group if env in self._routes]
            yield self._canvases[level].frame(positions[group], goals[group].reshape(-1, 3), routes)

    def redirect(
        self,
        env: int,
        waypoints: Sequence[Sequence[float] | Floats],
        start: Sequence[float] | Floats | None = None,
        yaw: float = 0.0,
    ) -> Floats:
        """Gives an environment a route of waypoints, m, and returns its observation.

        The observation points at the next waypoint as soon as the NPC has come within 1 m of the current one. The
        episode ends at the last waypoint. `start` first moves the NPC there, with the heading `yaw`, rad.
        """
        if not self._was_reset:
            raise ResetNeeded("call reset first")
        if self.setup.server is not None:
            raise NotImplementedError("redirect needs environments of this process: leave the server out")
        self._worlds.redirect(env, waypoints, start, yaw, self._observations)
        self._routes[env] = np.array([self.positions()[env], *waypoints], np.float32)
        if start is not None:
            self._terminated[env] = self._truncated[env] = False
        return np.array(self._observations[env])


def _checked_seed(seed: int | Sequence[int | None] | None) -> int | list[int] | None:
    """A seed, or one for each environment."""
    if seed is None:
        return None
    if isinstance(seed, (Sequence, np.ndarray)):
        return [fresh_seed() if each is None else checked_seed(each) for each in seed]
    return checked_seed(seed)
