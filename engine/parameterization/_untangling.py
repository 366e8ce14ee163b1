"""Newton descent of conformal distortion, from folds or within bijections; the rim may slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import NumericalError
from engine.linalg import ElementPattern, Factor
from engine.parameterization._mips_kernels import (
    determinants,
    dilatations,
    energy,
    first_fold,
    image_scale,
    keep_order,
    newton_system,
)
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

_NEARLY_FOLDED = 1e-4  # of the area that a face's surroundings suggest
_AREA_WEIGHT = 0.1  # of size against shape, while anything folds

_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e4  # of the Hessian's diagonal


@dataclass(frozen=True, slots=True)
class Goal:
    """The energy: ``weights`` (m,) of the faces, ``epsilon`` ε and ``area`` λ of the kernels."""

    weights: FloatArray
    epsilon: float = 0.0
    area: float = 0.0


class Descent:
    """Projected Newton steps on conformal distortion, on or off the way out of folds.

    ``a`` (m, 3) are face coefficients, ``faces`` (m, 3); vertices marked ``fixed`` (n,) stay;
    those of the boundary edges ``rim`` (k, 2) that are not fixed slide along the unit circle and
    never pass each other. So a face with all corners on the rim keeps its orientation, and plays
    no part: along an arc it cannot have the shape that it has on the surface.
    """

    def __init__(self, a: ComplexArray, faces: IntArray, fixed: BoolArray, rim: IntArray) -> None:
        n = len(fixed)
        on_rim = np.zeros(n, dtype=np.bool_)
        on_rim[rim] = True
        shaped = ~on_rim[faces].all(axis=1)
        self._a, self._faces, self._rim = a[shaped], faces[shaped], rim
        fixed = fixed.copy()
        fixed[np.bincount(self._faces.ravel(), minlength=n) == 0] = True
        self._sliding = on_rim & ~fixed
        free = np.stack([~(fixed | on_rim), ~fixed], axis=1)
        dofs = np.full((n, 2), -1, dtype=np.int64)
        dofs[free] = np.arange(int(free.sum()))
        self._free = free
        self._pattern = ElementPattern(dofs[self._faces].reshape(-1, 6), int(free.sum()))
        self._analysis = self._pattern.analyse()

    def step(
        self, w: ComplexArray, goal: Goal, *, damping: float
    ) -> tuple[ComplexArray, float, float]:
        """One Newton step with backtracking: positions (n,), energy before and after.

        The two energies are equal if no share of the step descends.
        """
        step, slope = self._newton(w, goal, damping)
        before = self._energy(w, goal)
        share = 1.0
        if goal.epsilon == 0.0:
            share = min(1.0, 0.9 * first_fold(self._a, self._faces, w, step))
        for _ in range(30):
            to = self._moved(w, step, share)
            after = self._energy(to, goal)
            if after <= before + 1e-4 * share * min(slope, 0.0) and after < before:
                return to, before, after
            share *= 0.5
        return w, before, before

    def _energy(self, w: ComplexArray, goal: Goal) -> float:
        return energy(self._a, goal.weights, self._faces, w, goal.epsilon, goal.area)

    def _newton(self, w: ComplexArray, goal: Goal, damping: float) -> tuple[ComplexArray, float]:
        frame = np.ones(len(w), dtype=np.complex128)
        frame[self._sliding] = w[self._sliding]
        pattern = self._pattern
        data, gradient = newton_system(
            self._a,
            goal.weights,
            self._faces,
            w,
            frame,
            goal.epsilon,
            goal.area,
            pattern.dofs,
            pattern.position,
            pattern.nnz,
            pattern.n,
        )
        x = self._damped(data, damping).solve(-gradient)
        along = np.zeros((len(w), 2))
        along[self._free] = x
        step = (along[:, 0] + 1j * along[:, 1]) * frame
        keep_order(self._rim, w, step)
        kept = np.stack([(step / frame).real, (step / frame).imag], axis=1)[self._free]
        return step, float(gradient @ kept)

    def _damped(self, data: FloatArray, damping: float) -> Factor:
        diagonal = self._analysis.diagonal
        own = data[diagonal].copy()
        for _ in range(7):
            data[diagonal] = own * (1 + damping) + 1e-3 * damping * own.mean()
            try:
                return self._analysis.factor(data)
            except NumericalError:
                damping *= 100
        data[diagonal] = own * (1 + damping) + 1e-3 * damping * own.mean()
        return self._analysis.factor(data)

    def _moved(self, w: ComplexArray, step: ComplexArray, share: float) -> ComplexArray:
        to = w + share * step
        rim = self._sliding
        to[rim] = w[rim] * np.exp(1j * share * (step[rim] / w[rim]).imag)
        to[rim] /= np.abs(to[rim])
        return to

    def untangle(self, w: ComplexArray, *, max_steps: int, tolerance: float) -> ComplexArray:
        """Minimise until no face folds and |f_z̄ / f_z| changes by less than ``tolerance``.

        The regularisation ε follows the energy's decrease (Garanzha et al. 2021, sec. 3) and
        is 0 once no face folds or nearly does. May return a map that still folds: the caller
        looks. Stops early where no step descends. Raises ``NumericalError`` on overflow.
        """
        if not len(self._faces):
            return w
        even = np.full(len(self._faces), 1 / len(self._faces))
        goal = Goal(even)
        damping = _LEAST_DAMPING
        for _ in range(max_steps):
            least = float(determinants(self._a, self._faces, w).min())
            if least > _NEARLY_FOLDED:
                goal = Goal(even)
            elif goal.epsilon == 0.0:
                goal = Goal(even, max(0.2 * abs(least), 0.02), _AREA_WEIGHT)
            to, before, after = self.step(w, goal, damping=damping)
            if before == after:
                damping = max(100 * damping, 1e-4)
                if damping > _MOST_DAMPING:
                    break
                continue
            damping = max(damping / 10, _LEAST_DAMPING)
            change = float(np.abs(self._change(to, w)).max())
            w = to
            if goal.epsilon == 0.0 and change < tolerance:
                break
            if goal.epsilon > 0.0:
                epsilon = self._next_epsilon(w, goal.epsilon, after / before)
                goal = Goal(even, epsilon, _AREA_WEIGHT)
        return w

    def _change(self, to: ComplexArray, w: ComplexArray) -> FloatArray:
        return dilatations(self._a, self._faces, to) - dilatations(self._a, self._faces, w)

    def _next_epsilon(self, w: ComplexArray, epsilon: float, ratio: float) -> float:
        least = float(determinants(self._a, self._faces, w).min())
        chi = 0.5 * (least + np.hypot(least, epsilon))
        goal = (1 - max(0.1, 1 - ratio)) * chi
        return 2 * float(np.sqrt(goal * (goal - least))) if least < goal else 1e-10


def scaled_coefficients(a: ComplexArray, faces: IntArray, w: ComplexArray) -> ComplexArray:
    """``a`` (m, 3) for faces scaled to the local size of their images, so that D is near 1."""
    return a / np.maximum(image_scale(faces, a, w, len(w)), 1e-300)[:, None]
