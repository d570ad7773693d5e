"""The rasteriser of solids. Importing this module imports numba; the first call compiles.

Triangles are drawn row by row into a frame of colours and one of nearness, 1 / depth, which is linear over a
triangle's pixels; the nearest one keeps a pixel. A pixel belongs to a triangle if its middle lies in it or
on its edge. Where an edge meets a row is computed from the edge alone, the same for both triangles that share
it: there are no gaps between them. No fast-math: the bytes of a data set must not depend on the machine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoprior.compiled import compiled, inlined

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Surfaces(NamedTuple):
    """Bodies of triangles, one after the other, each in its own frame.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3) int64 rows of ``vertices``, counter-clockwise seen from outside.
        normals: (F, 3) outward, of unit length; zeros of a face without area.
        heights: (F,) of a face's plane along its normal.
        colours: (B, 3) of each body, 0 to 1.
        nearer: (B,) factor on nearness by which a body is drawn before what lies in the same place.
        ends: (B, 2) where each body's vertices and faces end.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64]
    heights: NDArray[np.float64]
    colours: NDArray[np.float64]
    nearer: NDArray[np.float64]
    ends: NDArray[np.int64]


class Looks(NamedTuple):
    """How bodies are seen, step by step.

    Attributes:
        matrices: (N, B, 3, 4) from each body's frame to homogeneous pixels.
        eyes: (N, B, 3) the camera in each body's frame.
        lights: (N, B, 3) direction to the light in each body's frame, its length the light's share.
    """

    matrices: NDArray[np.float64]
    eyes: NDArray[np.float64]
    lights: NDArray[np.float64]


@compiled
def _project(
    matrix: NDArray[np.float64],
    vertices: NDArray[np.float64],
    begin: int,
    end: int,
    seen: NDArray[np.float64],
) -> None:
    """Homogeneous pixels (u w, v w, w), and pixels (u, v, 1 / w), of some vertices: rows of ``seen``."""
    a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3]
    e, f, g, h = matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[1, 3]
    i, j, k, m = matrix[2, 0], matrix[2, 1], matrix[2, 2], matrix[2, 3]
    for p in range(begin, end):
        x, y, z = vertices[p, 0], vertices[p, 1], vertices[p, 2]
        left = a * x + b * y + c * z + d
        down = e * x + f * y + g * z + h
        depth = i * x + j * y + k * z + m
        nearness = 1.0 / depth
        seen[p, 0], seen[p, 1], seen[p, 2] = left, down, depth
        seen[p, 3], seen[p, 4], seen[p, 5] = left * nearness, down * nearness, nearness


@compiled
def _shade(
    normal: NDArray[np.float64], light: NDArray[np.float64], ambient: float, colour: NDArray[np.float64]
) -> int:
    """Red, green and blue in the lowest bytes, by Lambert's law; a light's length is its share."""
    cosine = normal[0] * light[0] + normal[1] * light[1] + normal[2] * light[2]
    level = 255.0 * (ambient + max(0.0, cosine))
    red, green, blue = level * colour[0] + 0.5, level * colour[1] + 0.5, level * colour[2] + 0.5
    return int(red) | int(green) << 8 | int(blue) << 16


@inlined
def _fill_span(
    colours: NDArray[np.uint32],
    nearness: NDArray[np.float32],
    row: int,
    begin: int,
    end: int,
    shade: np.uint32,
    at_begin: np.float32,
    step: np.float32,
) -> None:
    """Draw pixels of a row, ``begin`` to before ``end``, whose nearness begins there and grows by a step."""
    for column in range(begin, end):
        here = at_begin + np.float32(column - begin) * step
        seen = here > nearness[row, column]
        nearness[row, column] = here if seen else nearness[row, column]
        colours[row, column] = shade if seen else colours[row, column]


@inlined
def _downwards(corners: NDArray[np.float64]) -> tuple[int, int, int]:
    """The three corners from the topmost to the lowest."""
    top, middle, bottom = 0, 1, 2
    if corners[top, 1] > corners[middle, 1]:
        top, middle = middle, top
    if corners[middle, 1] > corners[bottom, 1]:
        middle, bottom = bottom, middle
    if corners[top, 1] > corners[middle, 1]:
        top, middle = middle, top
    return top, middle, bottom


@compiled
def _fill(
    colours: NDArray[np.uint32],
    nearness: NDArray[np.float32],
    corners: NDArray[np.float64],
    colour: int,
    nearer: float,
) -> None:
    """Draw one triangle; rows of corners are column, row and nearness in pixels."""
    height, width = colours.shape
    top, middle, bottom = _downwards(corners)
    u0, v0, w0 = corners[top, 0], corners[top, 1], corners[top, 2]
    u1, v1, w1 = corners[middle, 0], corners[middle, 1], corners[middle, 2]
    u2, v2, w2 = corners[bottom, 0], corners[bottom, 1], corners[bottom, 2]
    first, last = int(np.ceil(max(v0, 0.0))), int(np.floor(min(v2, height - 1.0)))
    area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    if first > last or max(u0, u1, u2) < 0.0 or min(u0, u1, u2) > width - 1.0 or area == 0.0:
        return
    along = ((w1 - w0) * (v2 - v0) - (w2 - w0) * (v1 - v0)) / area
    down = ((w2 - w0) * (u1 - u0) - (w1 - w0) * (u2 - u0)) / area
    long = (u2 - u0) / (v2 - v0)
    upper, lower = (u1 - u0) / (v1 - v0), (u2 - u1) / (v2 - v1)
    shade, step = np.uint32(colour), np.float32(along * nearer)
    for row in range(first, last + 1):
        far = u0 + (row - v0) * long
        # A level edge has no slope; its row is the other edge's first or last.
        near = u0 + (row - v0) * upper if row < v1 else (u1 + (row - v1) * lower if v2 > v1 else u1)
        begin = int(np.ceil(max(min(far, near), 0.0)))
        end = int(np.floor(min(max(far, near), width - 1.0))) + 1
        at_begin = np.float32((w0 + along * (begin - u0) + down * (row - v0)) * nearer)
        _fill_span(colours, nearness, row, begin, end, shade, at_begin, step)


@compiled
def _clip(
    seen: NDArray[np.float64], face: NDArray[np.int64], nearest: float, out: NDArray[np.float64]
) -> int:
    """Cut a face off at the depth ``nearest``; the corners left, (u, v, 1 / w) rows of ``out``: 0, 3 or 4.

    A cut is computed from its edge's seen end to the other one: the same for both faces of the edge.
    """
    count = 0
    for corner in range(3):
        here, there = face[corner], face[(corner + 1) % 3]
        inside, other_inside = seen[here, 2] >= nearest, seen[there, 2] >= nearest
        if inside:
            out[count, 0], out[count, 1], out[count, 2] = seen[here, 3], seen[here, 4], seen[here, 5]
            count += 1
        if inside != other_inside:
            a, b = (here, there) if inside else (there, here)
            share = (seen[a, 2] - nearest) / (seen[a, 2] - seen[b, 2])
            out[count, 0] = (seen[a, 0] + share * (seen[b, 0] - seen[a, 0])) / nearest
            out[count, 1] = (seen[a, 1] + share * (seen[b, 1] - seen[a, 1])) / nearest
            out[count, 2] = 1.0 / nearest
            count += 1
    return count


@compiled
def _draw_bodies(
    surfaces: Surfaces,
    matrices: NDArray[np.float64],
    eyes: NDArray[np.float64],
    lights: NDArray[np.float64],
    ambient: float,
    nearest: float,
    seen: NDArray[np.float64],
    colours: NDArray[np.uint32],
    nearness: NDArray[np.float32],
) -> None:
    corners = np.empty((4, 3))
    first_vertex, first_face = 0, 0
    for body in range(len(surfaces.ends)):
        last_vertex, last_face = surfaces.ends[body, 0], surfaces.ends[body, 1]
        _project(matrices[body], surfaces.vertices, first_vertex, last_vertex, seen)
        eye = eyes[body]
        for f in range(first_face, last_face):
            normal = surfaces.normals[f]
            before = normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2] - surfaces.heights[f]
            if before <= 0.0:
                continue
            count = _clip(seen, surfaces.faces[f], nearest, corners)
            if count == 0:
                continue
            colour = _shade(normal, lights[body], ambient, surfaces.colours[body])
            _fill(colours, nearness, corners[:3], colour, surfaces.nearer[body])
            if count == 4:
                corners[1] = corners[0]
                _fill(colours, nearness, corners[1:], colour, surfaces.nearer[body])
        first_vertex, first_face = last_vertex, last_face


@compiled
def _unpack(colours: NDArray[np.uint32], frame: NDArray[np.uint8]) -> None:
    """Write colours as bytes: red, green, blue."""
    for p in range(colours.size):
        colour = colours[p]
        frame[3 * p] = colour & 255
        frame[3 * p + 1] = colour >> 8 & 255
        frame[3 * p + 2] = colour >> 16 & 255


@compiled
def draw(
    frames: NDArray[np.uint8],
    resting: Surfaces,
    rest: Looks,
    moving: Surfaces,
    ways: Looks,
    background: NDArray[np.float64],
    ambient: float,
    nearest: float,
) -> None:
    """Draw every frame.

    Args:
        frames: (N, H, W, 3), written.
        resting: What rests before a camera that does not move: drawn once.
        rest: How it is seen; one step.
        moving: Everything else.
        ways: How that is seen; N steps.
        background: (3,) colour, 0 to 1, where nothing is.
        ambient: Share of light that reaches every face.
        nearest: Surfaces are drawn from this depth on, metres.
    """
    steps, height, width = frames.shape[:3]
    shade = int(255.0 * background[0] + 0.5) | int(255.0 * background[1] + 0.5) << 8
    behind = np.full((height, width), np.uint32(shade | int(255.0 * background[2] + 0.5) << 16), np.uint32)
    beyond = np.zeros((height, width), np.float32)
    seen = np.empty((max(len(resting.vertices), len(moving.vertices)), 6))
    _draw_bodies(
        resting, rest.matrices[0], rest.eyes[0], rest.lights[0], ambient, nearest, seen, behind, beyond
    )
    colours, nearness = np.empty_like(behind), np.empty_like(beyond)
    for n in range(steps):
        colours[:], nearness[:] = behind, beyond
        _draw_bodies(
            moving, ways.matrices[n], ways.eyes[n], ways.lights[n], ambient, nearest, seen, colours, nearness
        )
        _unpack(colours.ravel(), frames[n].ravel())
