"""The BlueROV2's body in water: six degrees of freedom, written in velocity relative to the water.

Mass, drag and added mass as in von Benzon et al. (2022), "An Open-Source Benchmark Simulator: Control of a BlueROV2
Underwater Robot", JMSE 10(12). A neutrally buoyant body in water that accelerates is carried along with it, so the
velocity relative to the water follows the equations of still water.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from bluerov_slam.simulation.thrusters import Force

MASS_KG = 13.5
GRAVITY_MPS2 = 9.80665
ADDED_MASS_KG = (6.4, 7.1, 18.7)
INERTIA_KGM2 = (0.26 + 0.189, 0.23 + 0.135, 0.37 + 0.222)  # of the body and of the water that turns with it
DRAG_X = (13.7, 141.0)  # N per m/s, and per its square
DRAG_Y = (0.0, 217.0)
DRAG_Z = (33.0, 190.0)
TURN_DRAG = ((0.30, 1.19), (0.80, 0.47), (0.30, 1.50))
NET_BUOYANCY_N = 2.0
RIGHTING_ARM_M = 0.03  # centre of buoyancy above the centre of mass, with usual ballast
# Added mass alone would turn the hull broadside (Munk's moment) from 0.5 m/s on; behind a blunt one the flow parts.
MUNK_SHARE = 0.25
HEIGHT_M = 0.26
ANTENNA_FRD_M = (-0.05, 0.0, -0.22)  # GPS antenna from the centre of mass; the other instruments are taken to be at it

_WEIGHT_N = MASS_KG * GRAVITY_MPS2
_FULL_BUOYANCY_N = _WEIGHT_N + NET_BUOYANCY_N
FLOATING_DEPTH_M = HEIGHT_M * (_WEIGHT_N / _FULL_BUOYANCY_N - 0.5)

State = tuple[float, float, float, float, float, float, float, float, float, float, float, float, float]
"""North, east, down; quaternion w, x, y, z (NED from FRD); velocity through water u, v, w; rates p, q, r."""
Vector = tuple[float, float, float]


class Surroundings(NamedTuple):
    """What acts on the body at one instant besides its own motion."""

    thrust: Force
    water_ned_mps: Vector
    pull_ned_n: Vector
    torque_nm: Vector
    surface_m: float
    slope: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Hull:
    """One hull: `surge_scale`, `sway_scale` = its speed over the nominal one's for the same thrust, less 1."""

    surge_scale: float = 0.0
    sway_scale: float = 0.0

    def derivative(self, state: State, around: Surroundings) -> State:
        """Time derivative of the state."""
        _, _, down, qw, qx, qy, qz, u, v, w, p, q, r = state
        r11, r12, r13 = 1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)
        r21, r22, r23 = 2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qw * qx)
        r31, r32, r33 = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
        thrust, water, pull = around.thrust, around.water_ned_mps, around.pull_ned_n

        submerged = min(1.0, max(0.0, 0.5 + (down + around.surface_m) / HEIGHT_M))
        buoyancy = _FULL_BUOYANCY_N * submerged
        pull_n, pull_e, pull_d = pull[0], pull[1], pull[2] + _WEIGHT_N - buoyancy
        ahead, aside = u / (1.0 + self.surge_scale), v / (1.0 + self.sway_scale)
        force_x = thrust[0] + r11 * pull_n + r21 * pull_e + r31 * pull_d - ahead * (DRAG_X[0] + DRAG_X[1] * abs(ahead))
        force_y = thrust[1] + r12 * pull_n + r22 * pull_e + r32 * pull_d - aside * (DRAG_Y[0] + DRAG_Y[1] * abs(aside))
        force_z = thrust[2] + r13 * pull_n + r23 * pull_e + r33 * pull_d - w * (DRAG_Z[0] + DRAG_Z[1] * abs(w))

        added_x, added_y, added_z = ADDED_MASS_KG
        mass_x, mass_y, mass_z = MASS_KG + added_x, MASS_KG + added_y, MASS_KG + added_z
        inertia_x, inertia_y, inertia_z = INERTIA_KGM2
        slope_n, slope_e = around.slope
        lean_x = r31 + r11 * slope_n + r21 * slope_e
        lean_y = r32 + r12 * slope_n + r22 * slope_e
        righting = RIGHTING_ARM_M * buoyancy
        noise = around.torque_nm
        (kl, kq), (ml, mq), (nl, nq) = TURN_DRAG
        torque_x = thrust[3] + noise[0] - righting * lean_y - p * (kl + kq * abs(p))
        torque_y = thrust[4] + noise[1] + righting * lean_x - q * (ml + mq * abs(q))
        torque_z = thrust[5] + noise[2] - r * (nl + nq * abs(r))
        return (
            r11 * u + r12 * v + r13 * w + water[0],
            r21 * u + r22 * v + r23 * w + water[1],
            r31 * u + r32 * v + r33 * w + water[2],
            -0.5 * (qx * p + qy * q + qz * r),
            0.5 * (qw * p + qy * r - qz * q),
            0.5 * (qw * q + qz * p - qx * r),
            0.5 * (qw * r + qx * q - qy * p),
            (force_x - q * mass_z * w + r * mass_y * v) / mass_x,
            (force_y - r * mass_x * u + p * mass_z * w) / mass_y,
            (force_z - p * mass_y * v + q * mass_x * u) / mass_z,
            (torque_x + (inertia_y - inertia_z) * q * r + MUNK_SHARE * (added_y - added_z) * v * w) / inertia_x,
            (torque_y + (inertia_z - inertia_x) * r * p + MUNK_SHARE * (added_z - added_x) * w * u) / inertia_y,
            (torque_z + (inertia_x - inertia_y) * p * q + MUNK_SHARE * (added_x - added_y) * u * v) / inertia_z,
        )


def step(
    hull: Hull, state: State, begin: Surroundings, middle: Surroundings, end: Surroundings, step_s: float
) -> tuple[State, State]:
    """One step of the fourth-order Runge-Kutta method: the new state, and the derivative at the old one."""
    half = 0.5 * step_s
    first = hull.derivative(state, begin)
    second = hull.derivative(_plus(state, first, half), middle)
    third = hull.derivative(_plus(state, second, half), middle)
    fourth = hull.derivative(_plus(state, third, step_s), end)
    sixth = step_s / 6.0
    new = [
        x + sixth * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(state, first, second, third, fourth, strict=True)
    ]
    norm = 1.0 / math.sqrt(new[3] ** 2 + new[4] ** 2 + new[5] ** 2 + new[6] ** 2)
    for index in (3, 4, 5, 6):
        new[index] *= norm
    return tuple(new), first  # type: ignore[return-value]


def _plus(state: State, derivative: State, step_s: float) -> State:
    return tuple([x + step_s * d for x, d in zip(state, derivative, strict=True)])  # type: ignore[return-value]


def steady_speed_mps(force_n: float, drag: tuple[float, float] = DRAG_X) -> float:
    """Speed through still water at which drag equals this force."""
    linear, square = drag
    size = abs(force_n)
    return math.copysign((math.sqrt(linear**2 + 4.0 * square * size) - linear) / (2.0 * square), force_n)


def drag_n(speed_mps: float, drag: tuple[float, float] = DRAG_X) -> float:
    """Force needed to keep this speed."""
    return speed_mps * (drag[0] + drag[1] * abs(speed_mps))
