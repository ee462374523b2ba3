"""Stubs of the native module. `surefoot` exports its public part."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final, overload

import numpy as np
import numpy.typing as npt

_Floats: TypeAlias = npt.NDArray[np.float32]
_Indices: TypeAlias = npt.NDArray[np.uint32]
_Flags: TypeAlias = npt.NDArray[np.bool_]
_Ends: TypeAlias = tuple[npt.NDArray[np.int64], list[str], _Floats]
_Places: TypeAlias = npt.NDArray[np.floating[Any]]
_Point: TypeAlias = Sequence[float] | _Places
_Densities: TypeAlias = str | Mapping[str, float]
_Zone: TypeAlias = Mapping[str, Any]

VERSION: str
OBSERVATION_LEN: int
OBSERVATION_WITH_OTHERS_LEN: int
ACTION_LEN: int

def body_names() -> list[str]: ...
@final
class Level:
    """A level: the static geometry on which NPCs move, with its devices and movers.

    It never changes; copies share it.
    """

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

        `size` is a side in m, 50 to 1000, of a square map 80 m high, or width, height (40 to 200) and depth. `features`
        and `movers` are densities, 0 to 4: a text as the command line has it (`"all,lava=0"`), or a dict of changes
        (`{"lava": 0}`).
        """

    @staticmethod
    def load(
        path: str | PathLike[str],
        *,
        scale: float = 1.0,
        up: Literal["y", "z"] = "y",
        keep_sides: bool = False,
        names: bool = True,
        all_scenes: bool = False,
    ) -> Level:
        """Loads a saved map or imports a level (`.sfmap`, `.glb`, `.gltf`, `.obj`, `.zip`), with its `.surefoot.json`
        and the buffers beside it.

        `scale` is in metres per unit of the level, `up` its upright axis. `keep_sides` leaves fronts and backs as they
        were modelled. Without `names`, names of nodes have no meaning. `all_scenes` imports all scenes of a glTF. Saved
        maps ignore these.
        """

    @staticmethod
    def from_bytes(data: bytes) -> Level:
        """Reads the result of `to_bytes`, or the content of a level's file."""

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
    def origin(self) -> tuple[float, float, float]:
        """Position of the level's own origin on the map, m; zeros for generated maps."""

    @property
    def scale(self) -> float:
        """Metres per unit of the level's file."""

    @property
    def up(self) -> Literal["y", "z"]:
        """Upright axis of the level's file; on the map it is y."""

    @overload
    def to_map(self, place: Sequence[float]) -> tuple[float, float, float]: ...
    @overload
    def to_map(self, place: _Places | Sequence[Sequence[float]]) -> Any:
        """A place of the level's file on the map, m; or an array of places, a row for each."""

    @overload
    def to_level(self, place: Sequence[float]) -> tuple[float, float, float]: ...
    @overload
    def to_level(self, place: _Places | Sequence[Sequence[float]]) -> Any:
        """A place of the map, m, in the coordinates of the level's file; or an array of places, a row for each."""

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
        """Warnings about an imported level."""

    @property
    def nodes(self) -> list[dict[str, Any]]:
        """What became of each node of an imported level: `index`, `name`, `role`, `reason`, `triangles`, and `bounds`,
        the lowest and highest corner in the level's own coordinates, or `None`. Empty for maps."""

    def png(self, *, pixels_per_m: float = 3.0, view: Literal["top", "iso"] = "top") -> bytes:
        """A picture as the content of a PNG file."""

    def pixels(
        self, *, pixels_per_m: float = 3.0, view: Literal["top", "iso"] = "top"
    ) -> npt.NDArray[np.uint8]:
        """A picture as an array (height, width, 3)."""

    def _repr_png_(self) -> bytes: ...
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
        threads: int | None,
        server: Server | None,
    ) -> None: ...
    @property
    def observation_len(self) -> int: ...
    def reseed(self, seed: int | Sequence[int], observations: _Floats) -> None: ...
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

@final
class RustOnly:
    def __init__(self, level: Level, num_envs: int, goal_distance: tuple[float, float], seed: int) -> None: ...
    def seconds(self, actions: _Floats, steps: int) -> float: ...

@final
class Graph:
    """A graph of a level whose directed edges were proved by running a policy along them."""

    @staticmethod
    def build(
        level: Level,
        body: str | Mapping[str, float | int | bool] = "surefoot",
        *,
        policy: Policy | None = None,
        vertices: int = 300,
        seed: int = 0,
        threads: int | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> Graph:
        """Builds the graph of a level, by default on all cores and with the policy `general-reactive`.

        `progress` gets the numbers of finished and of known probes. Ctrl-C, or an exception that `progress`
        raises, ends the build.
        """

    @staticmethod
    def load(path: str | PathLike[str], level: Level | None = None) -> Graph:
        """Loads a file of `save` or of `surefoot graph export --format json`.

        With its level, the graph can be drawn, and asked in the level's own coordinates even if the file does not say
        where the level lies.
        """

    def save(self, path: str | PathLike[str]) -> None:
        """Saves the graph as JSON of nodes and links."""

    def plan(
        self,
        start: _Point,
        goal: _Point,
        *,
        without: Sequence[str] = (),
        prices: Mapping[str, float] = {},
        caution: float = 1.0,
        coordinates: Literal["map", "level"] = "map",
        zones: Sequence[_Zone] = (),
        tags: Sequence[str] = (),
    ) -> Plan:
        """Finds the cheapest plan from one place to another.

        `coordinates` are those of the places and of the plan: of the map, in m, or of the level's file, as in the tool
        that made it.

        `without` names abilities that the plan must not use (jump, double_jump, pad, zip_line,
        teleporter, jetpack, climb, mantle, swim, crouch, dash).
        `prices` names abilities and what each leg that uses them costs in addition to its time, 0 to 1000 s.
        `caution` is 0 to 1: with 0 dying costs no more than any failure.

        `zones` are dicts with `name`, and `box` (two opposite corners) or `bottom`, `radius` and `height` (m). With
        `price`, each metre inside counts as so many seconds more. With `only_with_tag`, the zone is closed unless `tags`
        has that tag, and with neither it is closed. It concerns all NPCs, or those with one of its `for_tags`. There are
        at most 256.
        """

    def rank(
        self,
        places: Sequence[_Point] | _Places,
        *,
        start: _Point | None = None,
        goal: _Point | None = None,
        by: Literal["cost", "seconds"] = "cost",
        best: int | None = None,
        without: Sequence[str] = (),
        prices: Mapping[str, float] = {},
        caution: float = 1.0,
        coordinates: Literal["map", "level"] = "map",
    ) -> list[Arrival]:
        """Finds what the plans from `start` to each place promise, or from each place to `goal`.

        The best come first: those of the lowest cost, of which risks are a part, or the quickest. Places without a
        path are last. The other arguments are those of `plan`.
        """

    def reachable(
        self,
        start: _Point,
        seconds: float,
        *,
        without: Sequence[str] = (),
        prices: Mapping[str, float] = {},
        caution: float = 1.0,
        coordinates: Literal["map", "level"] = "map",
    ) -> tuple[_Indices, _Floats]:
        """The vertices that an NPC reaches from a place within some seconds, and the time to each.

        The times are those of the cheapest paths, even if riskier ones are faster.
        """

    @property
    def vertices(self) -> _Floats:
        """Positions of the vertices, m: x, y and z for each."""

    @property
    def edge_count(self) -> int:
        """Number of directed edges."""

    def to_networkx(self) -> Any:
        """A `networkx.DiGraph`.

        Nodes have `position` and `island`; edges `ability`, `chance`, `death_chance`, `seconds` and `cost`, by which
        plans are the shortest paths.
        """

    def reach(self) -> dict[str, Any]:
        """Connectivity: the share of pairs with a path, the islands, and the loss without each ability."""

    def reachable_from(self, vertex: int) -> _Flags:
        """For each vertex, whether a path leads to it from `vertex`."""

    def png(self, *, pixels_per_m: float = 3.0, view: Literal["top", "iso"] = "top") -> bytes:
        """A picture on its level, as the content of a PNG file."""

    def _repr_png_(self) -> bytes | None: ...
    def __len__(self) -> int: ...

@final
class Leg:
    """One leg of a plan."""

    @property
    def from_vertex(self) -> int | None:
        """Vertex where the leg begins; `None` for the start."""

    @property
    def to_vertex(self) -> int | None:
        """Vertex where the leg ends; `None` for the goal."""

    @property
    def ability(self) -> str:
        """The most demanding ability that the leg needs."""

    @property
    def seconds(self) -> float:
        """Expected duration, including the cost of failures, s."""

    @property
    def chance(self) -> float:
        """Chance of success, 0 to 1."""

    @property
    def death_chance(self) -> float:
        """Chance of dying on it, 0 to 1."""

@final
class Arrival:
    """A place of many, and what the plan to it or from it promises; it is true if there is a path."""

    @property
    def index(self) -> int:
        """Index of the place."""

    @property
    def seconds(self) -> float:
        """Expected duration, s; infinite without a path."""

    @property
    def cost(self) -> float:
        """What the plan minimises, s: its duration plus terms for risks; infinite without a path."""

    @property
    def chance(self) -> float:
        """Estimated chance of arriving, for an NPC that rehearses its legs and plans again when one fails."""

    @property
    def death_chance(self) -> float:
        """Estimated chance of dying on the way, for an NPC that does not rehearse."""

    @property
    def no_path(self) -> Literal["start_off_graph", "goal_off_graph", "different_islands", "one_way"] | None:
        """Why there is no path."""

    def __bool__(self) -> bool: ...

@final
class Plan:
    """The answer to a query; it is true if there is a path."""

    @property
    def found(self) -> bool:
        """Whether there is a path."""

    @property
    def no_path(self) -> Literal["start_off_graph", "goal_off_graph", "different_islands", "one_way", "goal_in_zone"] | None:
        """Why there is no path."""

    @property
    def waypoints(self) -> _Places:
        """Waypoints in order, in the coordinates of the query (float64 in those of the level). The last one is the
        goal, or the reachable place nearest to it."""

    @property
    def legs(self) -> list[Leg]:
        """The legs that lead from one waypoint to the next."""

    @property
    def seconds(self) -> float:
        """Expected duration, s."""

    @property
    def chance(self) -> float:
        """Chance of arriving, 0 to 1."""

    @property
    def death_chance(self) -> float:
        """Chance of dying underway, 0 to 1."""

    def __bool__(self) -> bool: ...

@final
class Policy:
    """A trained policy. A recurrent policy keeps a memory for each row from one call to the next."""

    @staticmethod
    def load(name: str | PathLike[str] = "general-reactive", *, seed: int = 0) -> Policy:
        """Loads a shipped policy (`general-reactive`, `general-lstm`) or a model's folder; `seed` is the seed of the
        noise."""

    def act(self, observations: _Floats, *, reset: _Flags | None = None, noise: float = 0.5) -> _Floats:
        """Actions for observations, an array of 369 or 461 values for each.

        `reset` names the rows whose episodes have just begun: recurrent policies clear their memory. `noise` is the
        share of the exploration noise, 0 to 1; with half of it the policies do best.
        """

    def reset(self, *, seed: int | None = None) -> None:
        """Clears the memory of all rows, and restarts the noise if a seed is given."""

    @property
    def name(self) -> str:
        """Name of the weights."""

    @property
    def observation_len(self) -> int:
        """Values of an observation that the policy uses: 369, or 461 if it sees other bodies."""

    @property
    def is_recurrent(self) -> bool:
        """Whether the policy has a memory."""

    @property
    def memory(self) -> _Floats:
        """The memory of all rows, row by row."""

    @memory.setter
    def memory(self, memory: _Floats) -> None: ...

@final
class Server:
    """A world server."""

    @property
    def uri(self) -> str:
        """Its address."""

def state_fields() -> list[tuple[int, str, str, float, bool]]:
    """The values of the state vector in an observation: index, name, meaning, scale, and whether mirroring left to
    right flips the sign."""

def connect(
    uri: str,
    *,
    token: str | None = None,
    tls_ca: str | PathLike[str] | None = None,
    tls_client_cert: str | PathLike[str] | None = None,
    tls_client_key: str | PathLike[str] | None = None,
    tls_server_name: str | None = None,
    patience: float = 30.0,
) -> Server:
    """Connects to a world server at `grpc://host:port`, or with TLS at `grpcs://host:port`.

    `token` is the secret of a token. The files are in PEM format: the authority of the server's certificate (by default
    one that the system trusts), and the certificate and key of the client. If the connection is lost, the client tries
    to connect again for `patience` s.
    """
