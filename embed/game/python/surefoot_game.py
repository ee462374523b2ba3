"""Lets a game in Python run NPCs of Surefoot in its own physics, so that Surefoot proves graphs and measures success there.

One file, only the standard library. docs/reference/game-protocol.md describes the protocol.

    class MyGame(surefoot_game.Game):
        def open(self, body, count):
            return MyWorld(body, count)

    class MyWorld(surefoot_game.World):
        def place(self, character, feet, yaw): ...       # at rest, unharmed
        def tick(self, commands): ...                    # 1/60 s of the characters with commands
        def state(self, character): ...                  # a State
        def cast(self, origin, directions, range_m): ... # a Hit or None for each of 64 rays

    surefoot_game.serve("tcp://127.0.0.1:7701", MyGame())

An engine with a main loop of its own makes a Server once and calls its poll(0) each frame: it carries out what has been asked, on this
thread, and never waits. Time belongs to the caller of decisions: between them nothing moves, and the ten ticks of a decision are run at
once, not at the speed of the clock.

Right-handed, y up; metres, seconds, radians. Positions and directions are tuples (x, y, z). There is no password: listen on 127.0.0.1 or
on a Unix socket. A connection that speaks nonsense is refused in a line and closed; others go on. What a game raises goes to whoever
called serve or poll, except Refusal.
"""

import math
import os
import selectors
import socket
import stat
import struct
from typing import NamedTuple, Optional

VERSION = 1
TICKS = 10
TICK_SECONDS = 1.0 / 60.0
RAYS = 64
MAX_CHARACTERS = 4096
MAX_WORLDS = 64
MAX_PLACES = 1000

# Surfaces that rays hit.
GROUND, WATER, LAVA, PAD, ZIP_LINE, TELEPORTER, JETPACK = range(7)
# What a character did in the last tick: bits of State.events.
JUMPED, DOUBLE_JUMPED, PADDED, ZIPPED, TELEPORTED, THRUST = (1 << bit for bit in range(6))
# How a character came to harm.
FELL, BURNT, DROWNED = 1, 2, 3

_NOTHING = 255
_HELLO = struct.pack("<4s5I", b"SFGW", VERSION, TICKS, 60, RAYS, 36)
_HEADER = struct.Struct("<2I")
_OPEN = struct.Struct(f"<I20f{3 * RAYS}f")
_PLACES = struct.Struct("<QI")
_ENTRY = struct.Struct("<I4f")
_STATE = struct.Struct("<8fI")
_HITS = struct.Struct(f"<{RAYS}f{RAYS}B")
_REFUSED, _SAY_HELLO, _MAKE, _FIND, _DECIDE = range(5)
_MOST_REQUEST = 8 + 2 * _ENTRY.size * MAX_CHARACTERS


class Refusal(Exception):
    """Raise this when the game cannot carry out a request. The message says why; the connection ends."""


class Body(NamedTuple):
    """The body that characters are to have."""

    height: float  # m, from soles to crown
    radius: float  # m
    forward_speed: float  # m/s
    side_speed_share: float  # top speed backwards and sideways, as a share of forward_speed
    turn_speed: float  # rad/s
    jump_speed: float  # m/s upwards
    gravity: float  # m/s2
    extra_jumps: float  # jumps in the air before landing
    max_slope: float  # steepest walkable slope, rad
    step_height: float  # m, climbed without a jump
    ground_acceleration: float  # horizontal, m/s2
    air_acceleration: float  # horizontal, m/s2
    coyote_ticks: float  # ticks after leaving the ground in which a jump still is one from the ground
    uses_zip_lines: float  # 1 or 0
    zip_line_speed: float  # m/s
    uses_jetpacks: float  # 1 or 0
    jetpack_acceleration: float  # m/s2
    jetpack_climb_speed: float  # m/s


class Action(NamedTuple):
    """Each -1 to 1. strafe is positive to the right, turn as yaw grows; a jump is wanted above 0."""

    forward: float
    strafe: float
    turn: float
    jump: float


class Command(NamedTuple):
    """What a character does in a tick.

    In the first of the ten ticks of an action with jump above 0 one jump is wanted, as soon as it can be made within the ten.
    """

    character: int
    action: Action
    is_first: bool


class State(NamedTuple):
    """A character."""

    feet: tuple  # lowest point of the body, m
    velocity: tuple = (0.0, 0.0, 0.0)  # m/s
    yaw: float = 0.0  # rad; at 0 the body faces +z, at pi/2 it faces +x
    is_grounded: bool = False  # on ground on which it can walk
    can_jump: bool = False  # a jump wanted now would be made, from the ground or in the air
    rides: bool = False  # on a zip line
    is_in_water: bool = False
    fuel: float = 0.0  # seconds of jetpack thrust left
    events: int = 0  # what it did in the last tick
    harm: int = 0  # FELL, BURNT or DROWNED; ignored until it is placed again


class Hit(NamedTuple):
    """What a ray hit."""

    distance: float  # m, 0 to the range of the rays
    surface: int = GROUND


class World:
    """A world of the game. Characters count from 0 and do not get in each other's way."""

    def place(self, character: int, feet: tuple, yaw: float) -> None:
        """Puts a character there, at rest, unharmed and with nothing left of what it did."""
        raise NotImplementedError

    def tick(self, commands: list) -> None:
        """Advances the world by 1/60 s. The characters of `commands`, ascending, carry out their actions; others may be ignored."""
        raise NotImplementedError

    def state(self, character: int) -> State:
        """The state of a character."""
        raise NotImplementedError

    def cast(self, origin: tuple, directions: list, range_m: float) -> list:
        """What each of 64 rays from `origin` hits within `range_m`: a Hit, or None. Characters are not in the way of rays."""
        raise NotImplementedError

    def close(self) -> None:
        """Ends the world."""


class Game:
    """A level of the game, which makes worlds."""

    def open(self, body: Body, count: int) -> World:
        """Makes a world of `count` characters with this body, or raises Refusal."""
        raise NotImplementedError

    def places(self, seed: int, most: int) -> list:
        """At most `most` places to stand, drawn with `seed`; needed by training alone."""
        raise Refusal("it knows no places for goals at random: give goals")


class _Peer:
    """A connection, which is one world."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.received = bytearray()
        self.unsent = bytearray()
        self.said_hello = False
        self.is_closing = False
        self.world: Optional[World] = None
        self.count = 0
        self.eye = self.range_m = 0.0
        self.rays: list = []

    def answer(self, game: Game, kind: int, body: bytes) -> bytes:
        """Carries out a message, and returns the body of its answer."""
        if kind == _SAY_HELLO:
            if body != _HELLO:
                raise Refusal(f"the hello must be that of version {VERSION} of the batch protocol")
            self.said_hello = True
            return _HELLO
        if kind == _MAKE:
            return self._open(game, _OPEN.unpack(body))
        if kind == _FIND:
            seed, most = _PLACES.unpack(body)
            places = game.places(seed, min(most, MAX_PLACES))[:MAX_PLACES]
            return b"".join(struct.pack("<3f", *place) for place in places)
        if self.world is None:
            raise Refusal("there is no world: open one first")
        return self._decide(body)

    def _open(self, game: Game, values: tuple) -> bytes:
        count, values = values[0], values[1:]
        if self.world is not None:
            raise Refusal("a connection has one world, which is open: connect again")
        if not 1 <= count <= MAX_CHARACTERS:
            raise Refusal(f"a world has 1 to {MAX_CHARACTERS} characters")
        if not all(map(math.isfinite, values)):
            raise Refusal("the body or the rays have numbers that are not finite")
        self.world = game.open(Body(*values[:18]), count)
        self.count, self.eye, self.range_m = count, values[18], values[19]
        self.rays = [values[20 + 3 * ray : 23 + 3 * ray] for ray in range(RAYS)]
        return b""

    def _entries(self, body: bytes) -> list:
        entries = list(_ENTRY.iter_unpack(body))
        characters = [entry[0] for entry in entries]
        if any(one >= other for one, other in zip(characters, characters[1:])) or (characters and characters[-1] >= self.count):
            raise Refusal("a decision names characters that do not exist or do not ascend")
        if not all(math.isfinite(value) for entry in entries for value in entry):
            raise Refusal("a decision has numbers that are not finite")
        return entries

    def _decide(self, body: bytes) -> bytes:
        acting, placing = _HEADER.unpack_from(body)
        if acting > self.count or placing > self.count or len(body) != 8 + _ENTRY.size * (acting + placing):
            raise Refusal("the length of a decision does not agree with its counts")
        split = 8 + _ENTRY.size * acting
        actions, placements = self._entries(body[8:split]), self._entries(body[split:])
        world, answer = self.world, []
        states = [world.state(character) for character, *_ in actions]
        ticks: list = [[] for _ in actions]
        told = [(character, Action(*action)) for character, *action in actions]
        for tick in range(TICKS if actions else 0):
            moving = [idx for idx, state in enumerate(states) if not state.harm]
            world.tick([Command(*told[idx], tick == 0) for idx in moving])
            for idx in moving:
                states[idx] = world.state(told[idx][0])
            for packed, state in zip(ticks, states):
                packed.append(_pack_state(state))
        for packed, state in zip(ticks, states):
            answer += [*packed, self._look(state)]
        for character, x, y, z, yaw in placements:
            world.place(character, (x, y, z), yaw)
        for character, *_ in placements:
            state = world.state(character)
            answer += [_pack_state(state), self._look(state)]
        return b"".join(answer)

    def _look(self, state: State) -> bytes:
        x, y, z = state.feet
        sin, cos = math.sin(state.yaw), math.cos(state.yaw)
        # x of a ray is to the right of the body, z ahead of it.
        directions = [(sin * ahead - cos * right, up, cos * ahead + sin * right) for right, up, ahead in self.rays]
        hits = self.world.cast((x, y + self.eye, z), directions, self.range_m)
        distances = [hit[0] if hit else 0.0 for hit in hits]
        return _HITS.pack(*distances, *(hit[1] if hit else _NOTHING for hit in hits))


def _pack_state(state: State) -> bytes:
    feet, velocity, yaw, grounded, can_jump, rides, wet, fuel, events, harm = state
    flags = bool(grounded) | bool(can_jump) << 1 | bool(rides) << 2 | bool(wet) << 3 | events << 8 | harm << 16
    return _STATE.pack(*feet, *velocity, yaw, fuel, flags)


class Server:
    """Listens at `address`: tcp://HOST:PORT, where port 0 means a free one, or unix:PATH, where it replaces a socket that lies there."""

    def __init__(self, address: str, game: Game) -> None:
        self.game = game
        self.error = ""  # why a connection was refused last
        self._peers: dict = {}
        self._path = ""
        if address.startswith("tcp://"):
            host, _, port = address[6:].rpartition(":")
            self._listener = socket.create_server((host, int(port)), backlog=MAX_WORLDS)
        elif address.startswith("unix:"):
            self._path = address[5:]
            if os.path.exists(self._path) and stat.S_ISSOCK(os.stat(self._path).st_mode):
                os.unlink(self._path)
            self._listener = socket.socket(socket.AF_UNIX)
            self._listener.bind(self._path)
            self._listener.listen(MAX_WORLDS)
        else:
            raise ValueError(f"{address} is no address: it must be tcp://HOST:PORT or unix:PATH")
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)

    @property
    def port(self) -> int:
        """The port that is bound; 0 for a Unix socket."""
        return 0 if self._path else self._listener.getsockname()[1]

    def poll(self, timeout: Optional[float] = 0) -> int:
        """Carries out what has been asked, and returns how many messages that were.

        Waits up to `timeout` seconds for something to do: 0 not at all, None as long as it takes.
        """
        count = 0
        for key, events in self._selector.select(timeout):
            if key.fileobj is self._listener:
                self._accept()
            else:
                count += self._attend(key.data, events)
        return count

    def close(self) -> None:
        """Ends all worlds and closes all connections."""
        for peer in list(self._peers.values()):
            self._drop(peer)
        self._selector.close()
        self._listener.close()
        if self._path:
            os.unlink(self._path)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        if not self._path:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer = self._peers[connection] = _Peer(connection)
        self._selector.register(connection, selectors.EVENT_READ, peer)
        if len(self._peers) == MAX_WORLDS:
            # A client that connects now waits until a place is free.
            self._selector.unregister(self._listener)

    def _attend(self, peer: _Peer, events: int) -> int:
        """Serves a connection as far as that goes without waiting, and returns how many messages it sent."""
        count = 0
        try:
            if events & selectors.EVENT_READ:
                received = peer.connection.recv(1 << 16)
                if not received:
                    raise ConnectionResetError
                peer.received += received
            while True:
                if peer.unsent:
                    del peer.unsent[: peer.connection.send(peer.unsent)]
                if peer.unsent:
                    break
                if peer.is_closing:
                    raise ConnectionResetError
                if not self._message(peer):
                    break
                count += 1
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self._drop(peer)
            return count
        # Nothing more is read until the answer is gone.
        self._selector.modify(peer.connection, selectors.EVENT_WRITE if peer.unsent else selectors.EVENT_READ, peer)
        return count

    def _message(self, peer: _Peer) -> bool:
        """Carries out the first message if it is complete."""
        if len(peer.received) < 8:
            return False
        kind, length = _HEADER.unpack_from(peer.received)
        try:
            self._check(peer, kind, length)
            if len(peer.received) < 8 + length:
                return False
            body = bytes(peer.received[8 : 8 + length])
            del peer.received[: 8 + length]
            answer = peer.answer(self.game, kind, body)
        except Refusal as refusal:
            self.error = str(refusal)
            kind, answer = _REFUSED, self.error.encode()[:512] or b"refused"
            peer.is_closing = True
        peer.unsent += _HEADER.pack(kind, len(answer)) + answer
        return True

    @staticmethod
    def _check(peer: _Peer, kind: int, length: int) -> None:
        if not peer.said_hello and (kind, length) != (_SAY_HELLO, len(_HELLO)):
            raise Refusal("the first message is no hello of the batch protocol")
        lengths = {_SAY_HELLO: len(_HELLO), _MAKE: _OPEN.size, _FIND: _PLACES.size}
        if kind not in (*lengths, _DECIDE):
            raise Refusal("a message is of an unknown kind")
        if length != lengths.get(kind, length) or (kind == _DECIDE and not 8 <= length <= _MOST_REQUEST):
            raise Refusal("a message has a length that its kind cannot have")

    def _drop(self, peer: _Peer) -> None:
        if len(self._peers) == MAX_WORLDS:
            self._selector.register(self._listener, selectors.EVENT_READ)
        del self._peers[peer.connection]
        self._selector.unregister(peer.connection)
        peer.connection.close()
        if peer.world is not None:
            peer.world.close()


def serve(address: str, game: Game) -> None:
    """Serves worlds of `game` at `address` without end."""
    server = Server(address, game)
    while True:
        server.poll(None)
