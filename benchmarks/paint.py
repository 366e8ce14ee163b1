"""Skin painted on faces: colours that go with the skin, as two captures of it would have them."""

from __future__ import annotations

import numpy as np

from engine.locate import PointLocator
from engine.operators import vertex_normals
from engine.types import BoolArray, FloatArray, Mesh

_SKIN = np.array([0.72, 0.52, 0.43])
_BLOTCHES = ((0.15, 0.05), (0.05, 0.05), (0.02, 0.04))  # wavelength / diagonal, contrast
_WAVES = 24  # plane waves that make up the noise of one wavelength
_FRECKLES, _FRECKLE = 250, 0.006  # their number and radius / diagonal
_GAINS, _OFFSET, _SHADE = np.array([0.85, 0.75, 0.7]), 0.05, 0.15  # of the other capture
_NOISE = 0.02


def albedo(points: FloatArray, rest: Mesh, seed: int = 0) -> FloatArray:
    """The skin's colours (k, 3) in [0, 1] at ``points`` (k, 3) of the face at ``rest``."""
    random = np.random.default_rng(seed)
    diagonal = float(np.linalg.norm(np.ptp(rest.vertices, axis=0)))
    colours = np.tile(_SKIN, (len(points), 1))
    for length, contrast in _BLOTCHES:
        directions = random.normal(size=(3, _WAVES, 3))
        directions /= np.linalg.norm(directions, axis=2, keepdims=True)
        phases = random.uniform(0, 2 * np.pi, (3, _WAVES, 1))
        waves = np.cos(2 * np.pi / (length * diagonal) * directions @ points.T + phases)
        brown, red, blue = waves.sum(axis=1) * np.sqrt(2 / _WAVES) * contrast
        colours += np.stack([brown + 0.5 * red, brown - 0.5 * red, brown + 0.5 * blue], axis=1)
    spots = random.choice(len(rest.vertices), _FRECKLES, replace=False)
    radius = _FRECKLE * diagonal
    for spot in rest.vertices[spots]:
        near = np.exp(-(((points - spot) ** 2).sum(axis=1)) / (2 * radius**2))
        colours -= near[:, None] * [0.1, 0.13, 0.12]
    return colours.clip(0, 1)


def captures(
    rest: Mesh, truth: FloatArray, valid: BoolArray, target: Mesh
) -> tuple[FloatArray, FloatArray]:
    """Colours of ``rest`` (n, 3) and of ``target`` (m, 3), in 255ths, by ``truth`` (n, 3).

    The target is taken in another light, from the side, by another camera.
    """
    known = rest.faces[valid[rest.faces].all(axis=1)]
    skin = PointLocator(Mesh(truth, known)).nearest(target.vertices)[0]
    random = np.random.default_rng(1)
    here = albedo(rest.vertices, rest)
    there = albedo(skin.on(Mesh(rest.vertices, known)), rest)
    light = 1 + _SHADE * vertex_normals(target)[:, :1]
    there = _GAINS * there * light + _OFFSET
    return tuple(
        np.rint(255 * (c + _NOISE * random.normal(size=c.shape)).clip(0, 1)) for c in (here, there)
    )
