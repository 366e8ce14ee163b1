"""Newton descent of conformal distortion, from folds or within bijections; the rim may slide."""

from __future__ import annotations

import numpy as np

from engine.errors import NumericalError
from engine.linalg import ElementPattern, Factor
from engine.parameterization._mips_kernels import (
    determinants,
    dilatations,
    energy,
    first_fold,
    image_scale,
    newton_system,
)
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray


class Descent:
    """Projected Newton steps on Σ weights (|f_z|² + |f_z̄|²) / χ(|f_z|² - |f_z̄|²).

    ``a`` (m, 3) are face coefficients, ``faces`` (m, 3); vertices marked ``fixed`` (n,) stay,
    those ``sliding`` (n,) stay on the unit circle.
    """

    def __init__(
        self, a: ComplexArray, faces: IntArray, fixed: BoolArray, sliding: BoolArray
    ) -> None:
        self._a, self._faces, self._sliding = a, faces, sliding & ~fixed
        n = len(fixed)
        free = np.stack([~(fixed | sliding), ~fixed], axis=1)
        dofs = np.full((n, 2), -1, dtype=np.int64)
        dofs[free] = np.arange(int(free.sum()))
        self._free = free
        self._pattern = ElementPattern(dofs[faces].reshape(-1, 6), int(free.sum()))
        self._analysis = self._pattern.analyse()

    def newton(
        self, w: ComplexArray, weights: FloatArray, epsilon: float, damping: float
    ) -> tuple[ComplexArray, float]:
        """The step (n,) from ``w``, tangential for sliding vertices, and its slope (negative)."""
        frame = np.ones(len(w), dtype=np.complex128)
        frame[self._sliding] = w[self._sliding]
        pattern = self._pattern
        data, gradient = newton_system(
            self._a,
            weights,
            self._faces,
            w,
            frame,
            epsilon,
            pattern.dofs,
            pattern.position,
            pattern.nnz,
            pattern.n,
        )
        x = self._damped(data, damping).solve(-gradient)
        along = np.zeros((len(w), 2))
        along[self._free] = x
        return (along[:, 0] + 1j * along[:, 1]) * frame, float(gradient @ x)

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

    def moved(self, w: ComplexArray, step: ComplexArray, share: float) -> ComplexArray:
        """``w`` after ``share`` of ``step``; sliding vertices travel along the circle."""
        to = w + share * step
        rim = self._sliding
        to[rim] = w[rim] * np.exp(1j * share * (step[rim] / w[rim]).imag)
        to[rim] /= np.abs(to[rim])
        return to

    def search(
        self,
        w: ComplexArray,
        step: ComplexArray,
        slope: float,
        weights: FloatArray,
        epsilon: float,
    ) -> tuple[ComplexArray, float, float]:
        """Backtracking from ``w``: position, energy before, energy after (the same if stuck)."""
        before = energy(self._a, weights, self._faces, w, epsilon)
        share = 1.0
        if epsilon == 0.0:
            share = min(1.0, 0.9 * first_fold(self._a, self._faces, w, step))
        for _ in range(30):
            to = self.moved(w, step, share)
            after = energy(self._a, weights, self._faces, to, epsilon)
            if after <= before + 1e-4 * share * slope:
                return to, before, after
            share *= 0.5
        return w, before, before

    def untangle(self, w: ComplexArray, *, max_steps: int, tolerance: float) -> ComplexArray:
        """Minimise until no face folds and |f_z̄ / f_z| changes by less than ``tolerance``.

        The regularisation ε follows the energy's decrease (Garanzha et al. 2021, sec. 3) and
        is 0 once no face folds. May return a map that still folds: the caller looks.
        Stops early where no step descends. Raises ``NumericalError`` on overflow.
        """
        weights = np.full(len(self._faces), 1 / len(self._faces))
        epsilon = 0.0
        for _ in range(max_steps):
            least = float(determinants(self._a, self._faces, w).min())
            if least > 0:
                epsilon = 0.0
            elif epsilon == 0.0:
                epsilon = max(0.2 * abs(least), 0.02)
            step, slope = self.newton(w, weights, epsilon, 1e-9)
            to, before, after = self.search(w, step, slope, weights, epsilon)
            change = float(np.abs(self._change(to, w)).max())
            stuck = before == after
            w = to
            if stuck or (epsilon == 0.0 and change < tolerance):
                break
            if epsilon > 0.0:
                epsilon = self._next_epsilon(w, epsilon, after / before)
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
