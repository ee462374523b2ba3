"""A game of boxes: a level of upright boxes, and characters that walk, jump and fall on them, over surefoot_game.py.

    python3 embed/game/python/boxes.py embed/game/examples/boxes.obj tcp://127.0.0.1:7701 2 1 2
    surefoot eval --maps embed/game/examples/boxes.obj --world tcp://127.0.0.1:7701 --goals 50

The three numbers say where the origin of the level lies on Surefoot's map, as `surefoot map import` prints it. The rules are those of
embed/game/c/examples/boxes.c: each object of the .obj file is one box, and characters are upright boxes.
"""

import math
import sys

import surefoot_game
from surefoot_game import DOUBLE_JUMPED, FELL, JUMPED, TICK_SECONDS, Hit, State

MAX_FALL_SPEED = 45.0
TOUCH = 0.001  # m
CELL = 4.0  # m


class Level(surefoot_game.Game):
    """Boxes, each (low x, y, z, high x, y, z), and which of them lie over each cell of the ground."""

    def __init__(self, path: str, origin: tuple) -> None:
        self.boxes = []
        corners: list = []
        with open(path, encoding="utf-8") as file:
            for line in file:
                if line.startswith("o "):
                    corners.append([])
                elif line.startswith("v "):
                    corners[-1].append([float(it) + shift for it, shift in zip(line.split()[1:], origin)])
        for box in corners:
            axes = list(zip(*box))
            self.boxes.append((*map(min, axes), *map(max, axes)))
        self.low = min(box[1] for box in self.boxes) - 1.0
        self.cells: dict = {}
        for box in self.boxes:
            for x in range(int((box[0] - 1.0) // CELL), int((box[3] + 1.0) // CELL) + 1):
                for z in range(int((box[2] - 1.0) // CELL), int((box[5] + 1.0) // CELL) + 1):
                    self.cells.setdefault((x, z), []).append(box)

    def open(self, body, count):
        return World(self, body, count)


class Character:
    """A character, and what is left of its jumps."""

    def __init__(self, feet=(0.0, 0.0, 0.0), yaw=0.0):
        self.feet, self.velocity, self.yaw = list(feet), [0.0, 0.0, 0.0], yaw
        self.is_grounded = self.wants_jump = False
        self.ticks_in_air, self.air_jumps_left, self.events, self.harm = 255, 0, 0, 0


class World(surefoot_game.World):
    """Characters on the boxes of a level."""

    def __init__(self, level, body, count):
        self.level, self.body = level, body
        self.characters = [Character() for _ in range(count)]

    def place(self, character, feet, yaw):
        self.characters[character] = Character(feet, yaw)

    def state(self, character):
        it = self.characters[character]
        can_jump = it.is_grounded or it.ticks_in_air <= self.body.coyote_ticks or it.air_jumps_left > 0
        return State(it.feet, it.velocity, it.yaw, it.is_grounded, can_jump, events=it.events, harm=it.harm)

    def tick(self, commands):
        for character, action, is_first in commands:
            it = self.characters[character]
            if is_first:
                it.wants_jump = action.jump > 0.0
            self.steer(it, action)
            self.jump(it)
            self.move(it)

    def steer(self, it, action):
        """Turns the body, and changes its velocity as the action wants and gravity does."""
        body = self.body
        it.yaw += action.turn * body.turn_speed * TICK_SECONDS
        sin, cos = math.sin(it.yaw), math.cos(it.yaw)
        forward, right = max(action.forward, -body.side_speed_share), action.strafe * body.side_speed_share
        x, z = sin * forward - cos * right, cos * forward + sin * right
        length = max(math.hypot(x, z), 1.0)
        x, z = x / length * body.forward_speed - it.velocity[0], z / length * body.forward_speed - it.velocity[2]
        length = math.hypot(x, z)
        limit = (body.ground_acceleration if it.is_grounded else body.air_acceleration) * TICK_SECONDS
        share = limit / length if length > limit else 1.0
        it.velocity[0] += x * share
        it.velocity[2] += z * share
        it.velocity[1] = max(it.velocity[1] - body.gravity * TICK_SECONDS, -MAX_FALL_SPEED)

    def jump(self, it):
        """Makes the jump that is wanted, if it can be made."""
        is_near_ground = it.is_grounded or it.ticks_in_air <= self.body.coyote_ticks
        it.is_grounded, it.events = False, 0
        if not it.wants_jump or self.body.jump_speed <= 0.0 or not (is_near_ground or it.air_jumps_left > 0):
            return
        it.events = JUMPED if is_near_ground else DOUBLE_JUMPED
        it.air_jumps_left -= 0 if is_near_ground else 1
        it.velocity[1] = self.body.jump_speed
        it.ticks_in_air, it.wants_jump = 255, False

    def hit(self, x, y, z):
        """A box that a body whose feet are there reaches into."""
        radius, top = self.body.radius - TOUCH, y + self.body.height - TOUCH
        for box in self.level.cells.get((int(x // CELL), int(z // CELL)), ()):
            if (
                x + radius > box[0]
                and x - radius < box[3]
                and z + radius > box[2]
                and z - radius < box[5]
                and top > box[1]
                and y < box[4] - TOUCH
            ):
                return box
        return None

    def walk(self, it, axis):
        """Moves the body along one axis on the ground; what is no higher than a step lifts it."""
        there = list(it.feet)
        there[axis] += it.velocity[axis] * TICK_SECONDS
        wall = self.hit(*there)
        while wall and wall[4] <= it.feet[1] + self.body.step_height:
            there[1] = wall[4]
            wall = self.hit(*there)
        if wall:
            it.velocity[axis] = 0.0
        else:
            it.feet = there

    def move(self, it):
        """Moves the body as its velocity wants."""
        self.walk(it, 0)
        self.walk(it, 2)
        x, before, z = it.feet
        y = before + it.velocity[1] * TICK_SECONDS
        stop = self.hit(x, y, z)
        if stop and it.velocity[1] > 0.0:
            y, it.velocity[1] = before, 0.0
        elif stop:
            while stop:
                y = stop[4]
                stop = self.hit(x, y, z)
            it.velocity[1], it.is_grounded, it.ticks_in_air = 0.0, True, 0
            it.air_jumps_left = int(self.body.extra_jumps)
        if not it.is_grounded:
            it.ticks_in_air = min(it.ticks_in_air + 1, 255)
        it.feet = [x, y, z]
        it.harm = FELL if y < self.level.low else 0

    def cast(self, origin, directions, range_m):
        x, y, z = origin
        near = [
            (lx - x, ly - y, lz - z, hx - x, hy - y, hz - z)
            for lx, ly, lz, hx, hy, hz in self.level.boxes
            if lx - range_m < x < hx + range_m and lz - range_m < z < hz + range_m
        ]
        return [nearest(near, direction, range_m) for direction in directions]


def nearest(boxes, direction, range_m):
    """What a ray from the origin hits of `boxes`."""
    best = range_m
    ix, iy, iz = (1.0 / (it if abs(it) > 1.0e-9 else 1.0e-9) for it in direction)
    for lx, ly, lz, hx, hy, hz in boxes:
        one, other = lx * ix, hx * ix
        enters, leaves = (one, other) if one < other else (other, one)
        if leaves < 0.0 or enters >= best:
            continue
        one, other = lz * iz, hz * iz
        if one > other:
            one, other = other, one
        enters, leaves = one if one > enters else enters, other if other < leaves else leaves
        if leaves < 0.0 or enters >= best or enters > leaves:
            continue
        one, other = ly * iy, hy * iy
        if one > other:
            one, other = other, one
        enters, leaves = one if one > enters else enters, other if other < leaves else leaves
        if enters <= leaves and 0.0 <= leaves and enters < best:
            best = enters if enters > 0.0 else 0.0
    return Hit(best) if best < range_m else None


def main():
    if len(sys.argv) not in (3, 6):
        sys.exit("usage: boxes.py LEVEL.obj ADDRESS [X Y Z], such as: boxes.py boxes.obj tcp://127.0.0.1:7701 2 1 2")
    level = Level(sys.argv[1], tuple(map(float, sys.argv[3:])) or (0.0, 0.0, 0.0))
    server = surefoot_game.Server(sys.argv[2], level)
    print(f"{len(level.boxes)} boxes at port {server.port}", flush=True)
    # An engine would poll once a frame, with 0.
    while True:
        server.poll(None)


if __name__ == "__main__":
    main()
