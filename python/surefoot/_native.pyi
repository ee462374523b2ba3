"""What the native module offers; `surefoot` exports what is meant for users."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Literal, TypeAlias, final

import numpy as np
import numpy.typing as npt

_Floats: TypeAlias = npt.NDArray[np.float32]
_Flags: TypeAlias = npt.NDArray[np.bool_]
_Ends: TypeAlias = tuple[npt.NDArray[np.int64], list[str], _Floats]
_Point: TypeAlias = Sequence[float] | _Floats
_Densities: TypeAlias = str | Mapping[str, float]

OBSERVATION_LEN: int
OBSERVATION_WITH_OTHERS_LEN: int
ACTION_LEN: int

def body_names() -> list[str]: ...
@final
class Level:
    """A level: the static geometry on which NPCs move, with its devices and movers. It never changes; copies share it."""

    @staticmethod
    def generate(
        seed: int,
        *,
        size: int | tuple[int, int, int] = 250,
        kind: Literal["terrain", "islands", "interior", "arena", "tower", "open"] = "terrain",
        features: _Densities = "paper",
        movers: _Densities = "none",
        repair: bool = True,
    ) -> Level:
        """Generates a map. The same arguments give the same bits, here and on a server.

        `size` is a side in m, 50 to 1000, of a square map 80 m high, or width, height (40 to 200) and depth. `features` and `movers` are
        densities, 0 to 4: a text as the command line has it (`"all,lava=0"`), or a dict of changes (`{"lava": 0}`).
        """

    @staticmethod
    def load(path: str | PathLike[str]) -> Level:
        """Loads a saved map or imports a level (`.sfmap`, `.glb`, `.gltf`, `.obj`), with the `.surefoot.json` beside it if there is one."""

    @staticmethod
    def from_bytes(data: bytes) -> Level:
        """Reads what `to_bytes` wrote, or the content of a level's file."""

    def to_bytes(self) -> bytes:
        """The content of a saved map."""

    def save(self, path: str | PathLike[str]) -> None:
        """Saves the level as `.sfmap`."""

    @property
    def hash(self) -> str:
        """Hash of the content, in hexadecimal digits."""

    @property
    def size(self) -> tuple[int, int, int]:
        """Width (x), height (y) and depth (z), m."""

    @property
    def seed(self) -> int | None:
        """Seed of a generated map."""

    @property
    def kind(self) -> str | None:
        """Kind of a generated map."""

    @property
    def features(self) -> dict[str, int]:
        """Number of devices of each kind, and of movers."""

    @property
    def warnings(self) -> list[str]:
        """Oddities of an imported level that its designer may want to correct."""

    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

@final
class Worlds:
    def __init__(
        self,
        levels: Sequence[Level],
        body: str,
        solid: bool,
        num_envs: int,
        worlds: int,
        goal_distance: tuple[float, float],
        autoreset: str,
        seed: int,
        threads: int,
    ) -> None: ...
    @property
    def observation_len(self) -> int: ...
    def reseed(self, seed: int, observations: _Floats) -> None: ...
    def first_observations(self, observations: _Floats) -> None: ...
    def renew(self, mask: _Flags, observations: _Floats) -> None: ...
    def step(
        self, actions: _Floats, observations: _Floats, rewards: _Floats, terminated: _Flags, truncated: _Flags
    ) -> _Ends | None: ...
    def redirect(
        self, env: int, waypoints: Sequence[_Point], start: _Point | None, yaw: float, observations: _Floats
    ) -> None: ...
    def positions(self) -> _Floats: ...
    def goals(self) -> _Floats: ...
    def rests(self) -> _Flags: ...

def seconds_of_steps_in_rust(
    level: Level, goal_distance: tuple[float, float], seed: int, actions: _Floats, steps: int
) -> float: ...
