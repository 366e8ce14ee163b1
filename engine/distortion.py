"""Newton descent of conformal distortion, out of folds or within bijections; a rim may slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine._distortion_kernels import (
    area_ratios,
    dilatations,
    energy,
    first_fold,
    keep_order,
    newton_system,
)
from engine.errors import NumericalError
from engine.linalg import ElementPattern, Factor
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

_NEARLY_FOLDED = 1e-4  # as an area ratio
_AREA_WEIGHT = 0.1  # of size against shape, while anything folds
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e4  # of the Hessian's diagonal
_FOLD_SHARE, _LEAST_EPSILON = 0.2, 0.02  # of the worst area ratio; as one


@dataclass(frozen=True, slots=True)
class Untangled:
    """Positions ``w`` (n,), the linear systems solved, and whether no face nearly folds."""

    w: ComplexArray
    solves: int
    free: bool


class DistortionDescent:
    """Projected Newton steps on conformal distortion.

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

    def untangle(
        self,
        w: ComplexArray,
        *,
        most: int,
        tolerance: float = np.inf,
        least_ratio: float = _NEARLY_FOLDED,
        area: float = _AREA_WEIGHT,
    ) -> Untangled:
        """Minimise until no face folds and |f_z̄ / f_z| changes by less than ``tolerance``.

        The regularisation ε follows the energy's decrease (Garanzha et al. 2021, sec. 3) and
        is 0 once every face has more than ``least_ratio`` of its own area. May return a map that
        still folds: the caller looks. Stops early where no step descends. Raises
        ``NumericalError`` on overflow.
        """
        damping, epsilon, solves = _LEAST_DAMPING, 0.0, 0
        least = self._least(w)
        while len(self._faces) and solves < most:
            if least > least_ratio:
                if tolerance == np.inf:
                    break
                epsilon = 0.0
            elif epsilon == 0.0:
                epsilon = max(_FOLD_SHARE * abs(least), _LEAST_EPSILON)
            to, ratio = self._step(w, epsilon, area if epsilon > 0.0 else 0.0, damping)
            solves += 1
            if ratio == 1.0:
                damping = max(100 * damping, 1e-4)
                if damping > _MOST_DAMPING:
                    break
                continue
            damping = max(damping / 10, _LEAST_DAMPING)
            change = float(np.abs(self._dilatations(to) - self._dilatations(w)).max())
            w, least = to, self._least(to)
            if epsilon > 0.0:
                epsilon = _lowered(epsilon, least, 1 - ratio)
            elif change < tolerance:
                break
        return Untangled(w, solves, least > least_ratio)

    def _step(
        self, w: ComplexArray, epsilon: float, area: float, damping: float
    ) -> tuple[ComplexArray, float]:
        """One Newton step with backtracking: positions (n,), and the energy's ratio to before.

        The ratio is 1 if no share of the step descends.
        """
        step, slope = self._newton(w, epsilon, area, damping)
        before = energy(self._a, self._faces, w, epsilon, area)
        share = 1.0
        if epsilon == 0.0:
            share = min(1.0, 0.9 * first_fold(self._a, self._faces, w, step))
        for _ in range(30):
            to = slid(w, step, self._sliding, share)
            after = energy(self._a, self._faces, to, epsilon, area)
            if after <= before + 1e-4 * share * min(slope, 0.0) and after < before:
                return to, after / before
            share *= 0.5
        return w, 1.0

    def _dilatations(self, w: ComplexArray) -> FloatArray:
        return dilatations(self._a, self._faces, w)

    def _least(self, w: ComplexArray) -> float:
        return float(area_ratios(self._a, self._faces, w).min(initial=np.inf))

    def _newton(
        self, w: ComplexArray, epsilon: float, area: float, damping: float
    ) -> tuple[ComplexArray, float]:
        frame = np.ones(len(w), dtype=np.complex128)
        frame[self._sliding] = w[self._sliding]
        pattern = self._pattern
        data, gradient = newton_system(
            self._a,
            self._faces,
            w,
            frame,
            epsilon,
            area,
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


def slid(
    w: ComplexArray, step: ComplexArray, sliding: BoolArray, share: float = 1.0
) -> ComplexArray:
    """Places ``w`` (n,) after a ``share`` of ``step``, ``sliding`` (n,) ones along the circle.

    These are on the unit circle, and are again: they go along their arcs by what the step has of
    the tangent.
    """
    to = w + share * step
    here = w[sliding]
    turned = here * np.exp(1j * share * (step[sliding] / here).imag)
    to[sliding] = turned / np.abs(turned)
    return to


def _lowered(epsilon: float, least: float, gain: float) -> float:
    """The next ε, from the smallest area ratio and the relative decrease of the energy."""
    chi = 0.5 * (least + np.hypot(least, epsilon))
    reached = (1 - max(0.1, gain)) * chi
    return 2 * float(np.sqrt(reached * (reached - least))) if least < reached else 1e-10
