"""Closed forms that the scheme is verified against; SI units, slopes in degrees at this edge."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from runout.model.materials import Material

GRAVITY = 9.81


def sliding_block(time: float, slope_deg: float, friction: float) -> tuple[float, float]:
    """Displacement [m] and speed [m/s] along the slope of a rigid block from rest, Coulomb friction; exact."""
    slope = np.radians(slope_deg)
    acceleration = max(GRAVITY * (np.sin(slope) - friction * np.cos(slope)), 0.0)
    return 0.5 * acceleration * time**2, acceleration * time


@dataclass(frozen=True)
class ZonesDownSlope:
    """Zones of friction one after another down a plane, and the speed of a stiff body that crosses their borders.

    The body presses alike on all of the ground below it, so that a zone acts by its share of the length of the body: with the share
    s_i beyond border i, the means are m = mu_0 + sum(s_i dmu_i), and k alike, and d(v^2)/dX = 2 g (sin - m cos) - 2 v^2 k with the
    place X of the centre. Within a zone that is v^2 = v_0^2 + 2 g L (sin - mu cos) for k = 0, and else
    v^2 = v_inf^2 + (v_0^2 - v_inf^2) exp(-2 k L).

    Friction may act by a ``lever`` b below the centre of mass. Then the centre of pressure lies b m ahead of it. A rigid body of
    length L presses by p = p_0 (1 + 12 b m x / L^2) at x from its centre, and
    m = (mu_0 + sum(s_i dmu_i)) / (1 - 6 b/L sum(s_i (1 - s_i) dmu_i)).
    """

    borders: tuple[float, ...]  # places [m] down the slope at which one zone ends and the next begins, in order
    friction: tuple[float, ...]  # Coulomb coefficients [1], one more than borders
    # k [1/m] of each zone, g/(xi h) of Voellmy friction under a thickness h normal to the slope; empty for none
    drag: tuple[float, ...] = ()

    def beyond(self, place: float, length: float) -> np.ndarray:
        """Shares (borders,) [1] of a body of ``length`` [m], with its centre at ``place`` [m], beyond the borders."""
        return np.clip((place + length / 2 - np.array(self.borders)) / length, 0.0, 1.0)

    def speeds(self, places: np.ndarray, length: float, slope_deg: float, start: float, lever: float = 0.0) -> np.ndarray:
        """Speeds (n,) [m/s] of a body of ``length`` [m] with its centre at rising ``places`` (n,) [m]; ``start`` at the first."""
        slope, drag = np.radians(slope_deg), self.drag or (0.0,) * len(self.friction)

        def change(place: float, square: np.ndarray) -> np.ndarray:
            s, steps = self.beyond(place, length), np.diff(self.friction)
            mean = (self.friction[0] + steps @ s) / (1.0 - 6.0 * lever / length * (steps @ (s * (1.0 - s))))
            return 2.0 * (GRAVITY * (np.sin(slope) - mean * np.cos(slope)) - (drag[0] + np.diff(drag) @ s) * square)

        span, step = (places[0], places[-1]), length / 20
        solution = solve_ivp(change, span, [start**2], t_eval=places, rtol=1e-9, atol=1e-9, max_step=step)
        return np.sqrt(solution.y[0])  # type: ignore[no-any-return]


def symplectic_excess(time: float, slope_deg: float, friction: float, dt: float) -> float:
    """Displacement of a block [m] that symplectic Euler adds: a T dt/2, exact."""
    return sliding_block(time, slope_deg, friction)[1] * dt / 2


def symplectic_free_fall(steps: int, dt: float) -> tuple[float, float]:
    """Height [m] and velocity [m/s] after ``steps`` of symplectic Euler from rest at 0; exact."""
    return -GRAVITY * dt**2 * steps * (steps + 1) / 2, -steps * GRAVITY * dt


def rotated(position: np.ndarray, angle: float) -> np.ndarray:
    """Positions (n, 3) after a rotation about z by ``angle`` [rad]; exact."""
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return position @ turn.T


def axisymmetric_runout(aspect: float) -> float:
    """Run-out (R_f - R_0)/R_0 of a granular column of H_0/R_0 = ``aspect``, fit of experiments, scatter 15 to 25 %.

    Lube, Huppert, Sparks & Hallworth 2004, J. Fluid Mech. 508:175.
    """
    return float(1.24 * aspect if aspect < 1.7 else 1.6 * np.sqrt(aspect))


def axisymmetric_height(aspect: float) -> float:
    """Final height H_f/R_0 of a granular column, fit of experiments.

    Lajeunesse, Mangeney-Castelnau & Vilotte 2004, Phys. Fluids 16:2371.
    """
    return min(aspect, 0.74)


def standing_column(height: np.ndarray, length: float, weight: float, modulus: float) -> tuple[np.ndarray, ...]:
    """Stretch [1], Cauchy stress [Pa] and present height [m] of a Hencky column at rest under its weight; exact.

    ``height`` (n,) and ``length`` [m] are those of the stress-free state. With the specific weight rho_0 g [N m-3] and the
    confined modulus M [Pa] it is sigma = M ln F / F = -rho_0 g (l_0 - Y).
    """
    stress = -weight * (length - np.asarray(height, float))
    node, share = np.polynomial.legendre.leggauss(24)  # height = integral of the stretch
    inner = np.asarray(height, float)[:, None] * (node + 1) / 2
    below = np.exp(-np.real(lambertw(weight * (length - inner) / modulus)))
    return np.exp(-np.real(lambertw(-stress / modulus))), stress, below @ share * height / 2


@dataclass(frozen=True)
class AxisAlignedWave:
    """Standing waves u_i = A_i sin(pi X_i) sin(pi (phase_i + c t)) with c = sqrt(E/rho) in a Hencky solid; exact.

    Wallstedt & Guilkey 2008, J. Comput. Phys. 227:9628, sec. 5; the body force is derived here for tau_i = lambda ln J +
    2 mu ln F_i. A direction without amplitude is one of plane strain. The solution repeats after 2 m.
    """

    material: Material
    amplitude: tuple[float, float, float]

    def _phases(self, X: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
        c = np.sqrt(self.material.modulus / self.material.density)
        phase = np.pi * (np.array([0.0, 2 / 3, 4 / 3]) + c * t)
        A = np.array(self.amplitude)
        return A * np.sin(np.pi * X), A * np.cos(np.pi * X), np.sin(phase), np.pi * c * np.cos(phase)

    def displacement(self, X: np.ndarray, t: float) -> np.ndarray:
        """u (n, 3) [m] of points whose place in the stress-free state is X (n, 3) [m]."""
        S, _, swing, _ = self._phases(X, t)
        return S * swing

    def velocity(self, X: np.ndarray, t: float) -> np.ndarray:
        """v (n, 3) [m/s]."""
        S, _, _, rate = self._phases(X, t)
        return S * rate

    def stretch(self, X: np.ndarray, t: float) -> np.ndarray:
        """Diagonal (n, 3) of F [1]."""
        _, C, swing, _ = self._phases(X, t)
        return 1 + np.pi * C * swing

    def velocity_gradient(self, X: np.ndarray, t: float) -> np.ndarray:
        """Diagonal (n, 3) of the spatial velocity gradient [1/s]."""
        _, C, _, rate = self._phases(X, t)
        return np.pi * C * rate / self.stretch(X, t)

    def body_force(self, X: np.ndarray, t: float) -> np.ndarray:
        """b (n, 3) [m/s2] that the motion needs: acceleration less the divergence of P_i = tau_i/F_i over rho."""
        m, F, u = self.material, self.stretch(X, t), self.displacement(X, t)
        tau = m.lame_lambda * np.log(F.prod(axis=1))[:, None] + 2 * m.shear_modulus * np.log(F)
        inertia = -m.modulus / m.density
        return np.pi**2 * u * (inertia + (m.lame_lambda + 2 * m.shear_modulus - tau) / (m.density * F**2))


@dataclass(frozen=True)
class Vortex:
    """Rings of 0.75 m < R < 1.25 m turn by alpha = A sin(pi c t) (1 - 16 (R - 1)^2)^2 in a Hencky solid; plane strain, exact.

    Kamojjala, Brannon, Sadeghirad & Guilkey 2015, Eng. Comput. 31:213; the body force is derived here for Hencky's law:
    isochoric shear gamma = R d(alpha)/dR gives sigma_rt = mu w/k, sigma_rr = -sigma_tt = -mu w gamma/(2 k) with
    w = 2 asinh(gamma/2), k^2 = 1 + gamma^2/4.
    """

    material: Material
    amplitude: float

    def _turn(self, X: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
        """Radius, profile h, h', h'' over the radius, and the swing with its two rates."""
        R = np.hypot(X[:, 0], X[:, 1])
        s = np.where(np.abs(R - 1) < 0.25, R - 1, 0.25)
        h, dh = (1 - 16 * s**2) ** 2, -64 * s * (1 - 16 * s**2)
        ddh = np.where(np.abs(R - 1) < 0.25, 3072 * s**2 - 64, 0.0)
        rate = np.pi * np.sqrt(self.material.modulus / self.material.density)
        swing = self.amplitude * np.array([np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)])
        return R, h, dh, ddh, swing

    def _frame(self, X: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors (n, 2) outwards and around where the points are at time t."""
        _, h, _, _, swing = self._turn(X, t)
        angle = np.arctan2(X[:, 1], X[:, 0]) + swing[0] * h
        return np.stack([np.cos(angle), np.sin(angle)], 1), np.stack([-np.sin(angle), np.cos(angle)], 1)

    def place(self, X: np.ndarray, t: float) -> np.ndarray:
        """x (n, 2) [m] of points that were at X (n, 2) [m]."""
        return np.hypot(X[:, 0], X[:, 1])[:, None] * self._frame(X, t)[0]

    def velocity(self, X: np.ndarray, t: float) -> np.ndarray:
        """v (n, 2) [m/s]."""
        R, h, _, _, swing = self._turn(X, t)
        return (R * swing[1] * h)[:, None] * self._frame(X, t)[1]

    def velocity_gradient(self, X: np.ndarray, t: float) -> np.ndarray:
        """Spatial velocity gradient (n, 2, 2) [1/s] of the flow around the centre."""
        R, h, dh, _, swing = self._turn(X, t)
        out, around = self._frame(X, t)
        shear = swing[1] * (h + R * dh)
        turning = -swing[1] * h
        return np.einsum("n,ni,nj->nij", shear, around, out) + np.einsum("n,ni,nj->nij", turning, out, around)

    def body_force(self, X: np.ndarray, t: float) -> np.ndarray:
        """b (n, 2) [m/s2] that the motion needs: acceleration less the divergence of the stress over rho."""
        R, h, dh, ddh, swing = self._turn(X, t)
        out, around = self._frame(X, t)
        mu, g, dg = self.material.shear_modulus, R * swing[0] * dh, swing[0] * (dh + R * ddh)
        k, w = np.sqrt(1 + g**2 / 4), 2 * np.arcsinh(g / 2)
        shear, radial = mu * w / k, -mu * w * g / (2 * k)
        dshear = mu * dg * (1 / k**2 - w * g / (4 * k**3))
        dradial = -mu / 2 * dg * (g / k**2 + w / k - w * g**2 / (4 * k**3))
        outwards = -R * (swing[1] * h) ** 2 - (dradial + 2 * radial / R) / self.material.density
        sideways = R * swing[2] * h - (dshear + 2 * shear / R) / self.material.density
        return outwards[:, None] * out + sideways[:, None] * around
