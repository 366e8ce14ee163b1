"""Conformal automorphisms of the unit disk: the freedom that a disk map leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import NumericalError
from engine.types import ComplexArray, FloatArray


@dataclass(frozen=True, slots=True)
class DiskAutomorphism:
    """z -> rotation (z - a) / (1 - conj(a) z), with |a| < 1 and |rotation| = 1."""

    a: complex = 0j
    rotation: complex = 1 + 0j

    def __post_init__(self) -> None:
        if not abs(self.a) < 1 or abs(abs(self.rotation) - 1) > 1e-9:
            raise NumericalError(
                f"a disk automorphism needs |a| < 1 and |rotation| = 1, not a = {self.a} and "
                f"rotation = {self.rotation}",
                code="not_an_automorphism",
            )

    def __call__(self, z: ComplexArray) -> ComplexArray:
        """Apply to points of the closed disk."""
        return self.rotation * (z - self.a) / (1 - self.a.conjugate() * z)

    def inverse(self) -> DiskAutomorphism:
        """The automorphism that undoes this one."""
        return DiskAutomorphism(-self.a * self.rotation, self.rotation.conjugate())

    def then(self, after: DiskAutomorphism) -> DiskAutomorphism:
        """The composition ``after`` ∘ self."""
        carried = 1 + after.a * (self.a * self.rotation).conjugate()
        a = (self.rotation * self.a + after.a) / (self.rotation * carried)
        rotation = after.rotation * self.rotation * carried / carried.conjugate()
        return DiskAutomorphism(a, rotation / abs(rotation))


def _step(delta: complex, angle: float) -> DiskAutomorphism:
    """An automorphism near z + i angle z - delta + conj(delta) z², kept inside the disk."""
    delta *= min(1.0, 0.5 / max(abs(delta), 1e-300))
    return DiskAutomorphism(delta, complex(np.exp(1j * angle)))


def centring(z: ComplexArray, weights: FloatArray) -> DiskAutomorphism:
    """The automorphism without rotation that brings the weighted mean of ``z`` (n,) to 0.

    It exists and is unique unless half of the weight lies in one point of the circle
    (Douady & Earle 1986). Newton's method on the mean, to rounding.
    """
    share = weights / weights.sum()
    found = DiskAutomorphism()
    for _ in range(50):
        moved = found(z)
        mean, square = complex(share @ moved), complex(share @ moved**2)
        delta = (mean + square * mean.conjugate()) / max(1 - abs(square) ** 2, 1e-12)
        found = found.then(_step(delta, 0.0))
        if abs(mean) < 1e-13:
            break
    return DiskAutomorphism(found.a)


def align_disk(z: ComplexArray, onto: ComplexArray, weights: FloatArray) -> DiskAutomorphism:
    """The automorphism phi that minimises Σ weights |phi(z) - onto|² over points (k,).

    Starts from the best rotation; damped Gauss-Newton on the three parameters. Fewer than two
    distinct points leave freedom, of which the smallest change is taken.
    """
    total = float(weights.sum())
    if total <= 0:
        return DiskAutomorphism()
    share = weights / total
    turn = complex(share @ (z.conjugate() * onto))
    found = DiskAutomorphism(0j, turn / abs(turn) if abs(turn) > 1e-12 else 1 + 0j)
    cost = float(share @ np.abs(found(z) - onto) ** 2)
    damping = 1e-6
    for _ in range(100):
        y = found(z)
        partial = np.stack([-1 + y**2, -1j * (1 + y**2), 1j * y], axis=1)
        normal = ((partial.conjugate() * share[:, None]).T @ partial).real
        descent = -((partial.conjugate() * share[:, None]).T @ (y - onto)).real
        real, imaginary, angle = np.linalg.solve(normal + damping * np.eye(3), descent)
        trial = found.then(_step(complex(real, imaginary), float(angle)))
        trial_cost = float(share @ np.abs(trial(z) - onto) ** 2)
        gained = cost - trial_cost
        if gained >= 0:
            found, cost, damping = trial, trial_cost, max(damping / 10, 1e-12)
        else:
            damping *= 10
        if abs(gained) <= 1e-15 * (1 + cost) and (gained >= 0 or damping > 1e3):
            break
    return found
