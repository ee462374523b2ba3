"""Pictures of environments: their level from above, with NPCs, goals and routes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from ._native import Level
from ._setup import Floats

Frame: TypeAlias = npt.NDArray[np.uint8]

RENDER_MODES = ["rgb_array"]
RENDER_FPS = 6
"""Decisions a second, so that films run in real time."""
_SIDE = 480
_NPC = (255, 255, 255)
_GOAL = (255, 40, 40)
_ROUTE = (255, 255, 255)
_RIM = (0, 0, 0)


def checked_mode(render_mode: str | None) -> str | None:
    """A render mode that there is."""
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise ValueError(f"render_mode is {render_mode!r}, but must be 'rgb_array' or None")
    return render_mode


class Canvas:
    """A level from above. Movers are not drawn."""

    def __init__(self, level: Level) -> None:
        width, _, depth = level.size
        self._pixels_per_m = max(_SIDE / max(width, depth), 0.1)
        self._level: Frame = level.pixels(pixels_per_m=self._pixels_per_m)

    def frame(self, npcs: Floats, goals: Floats, routes: Iterable[Floats] = ()) -> Frame:
        """A picture with these places: an array (height, width, 3)."""
        frame = self._level.copy()
        for route in routes:
            for start, end in zip(route, route[1:], strict=False):
                self._line(frame, start, end)
        for places, colour in ((goals, _GOAL), (npcs, _NPC)):
            for place in places:
                self._disc(frame, place, 5.5, _RIM)
                self._disc(frame, place, 4.0, colour)
        return frame

    def _disc(self, frame: Frame, place: Floats, radius: float, colour: tuple[int, int, int]) -> None:
        x, _, z = place * self._pixels_per_m
        left, top = max(int(x - radius), 0), max(int(z - radius), 0)
        part = frame[top : max(int(z + radius) + 2, 0), left : max(int(x + radius) + 2, 0)]
        rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
        part[(top + rows + 0.5 - z) ** 2 + (left + columns + 0.5 - x) ** 2 <= radius**2] = colour

    def _line(self, frame: Frame, start: Floats, end: Floats) -> None:
        ends = np.stack([start, end])[:, [2, 0]] * self._pixels_per_m
        count = int(np.abs(ends[1] - ends[0]).max()) + 2
        pixels = np.linspace(ends[0], ends[1], count).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < frame.shape[:2])).all(axis=1)
        frame[tuple(pixels[inside].T)] = _ROUTE
