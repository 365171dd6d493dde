"""The plain way to write a 15-state strapdown filter, and two published filters that run it.

Position, velocity, attitude (error on the left, NED), gyro bias, accelerometer bias. The model is the textbook's: dense
matrices, first order in the step but for the rotation. filterpy and navlie bring the filter, this module the model:
navlie 0.0.1 as published cannot import its own IMU model, which needs a package that was never published (`pylie`).
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import Any

import filterpy
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from bluerov_slam.navigation.rotation import log_so3

STATES = 15


def skew(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exponential(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if angle < 1e-8:
        return np.eye(3) + skew(vector)
    axis = skew(vector / angle)
    return np.eye(3) + np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis


class Nominal:
    """Rotation (3, 3), and position, velocity, gyro bias, accelerometer bias in one vector (12,)."""

    def __init__(self, rotation: np.ndarray, vector: np.ndarray) -> None:
        self.rotation = rotation
        self.vector = vector

    def copy(self) -> Nominal:
        return Nominal(self.rotation.copy(), self.vector.copy())

    def plus(self, error: np.ndarray) -> Nominal:
        vector = self.vector.copy()
        vector[:6] += error[:6]
        vector[6:] += error[9:]
        return Nominal(exponential(error[6:9]) @ self.rotation, vector)

    def minus(self, other: Nominal) -> np.ndarray:
        """The error that `plus` puts onto the other to make it this one."""
        difference = self.vector - other.vector
        return np.concatenate([difference[:6], log_so3(self.rotation @ other.rotation.T), difference[6:]])


class PlainModel:
    """Strapdown prediction with its transition and noise."""

    def __init__(self, gravity_mps2: float, accel: float, gyro: float, gyro_walk: float, accel_walk: float) -> None:
        self.gravity_ned_mps2 = np.array([0.0, 0.0, gravity_mps2])
        self.noise = np.diag(np.repeat([0.0, accel**2, gyro**2, gyro_walk**2, accel_walk**2], 3))

    def move(self, nominal: Nominal, force: np.ndarray, rate: np.ndarray, dt: float) -> Nominal:
        turn = (rate - nominal.vector[6:9]) * dt
        middle = nominal.rotation @ exponential(0.5 * turn)
        acceleration = middle @ (force - nominal.vector[9:12]) + self.gravity_ned_mps2
        vector = nominal.vector.copy()
        vector[:3] += dt * vector[3:6] + 0.5 * dt * dt * acceleration
        vector[3:6] += dt * acceleration
        return Nominal(nominal.rotation @ exponential(turn), vector)

    def transition(self, nominal: Nominal, force: np.ndarray, dt: float) -> np.ndarray:
        pull = skew(nominal.rotation @ (force - nominal.vector[9:12]))
        matrix = np.eye(STATES)
        matrix[0:3, 3:6] = dt * np.eye(3)
        matrix[0:3, 6:9] = -0.5 * dt * dt * pull
        matrix[3:6, 6:9] = -dt * pull
        matrix[0:3, 12:15] = -0.5 * dt * dt * nominal.rotation
        matrix[3:6, 12:15] = -dt * nominal.rotation
        matrix[6:9, 9:12] = -dt * nominal.rotation
        return matrix


class FilterpyRun:
    """filterpy's extended Kalman filter on the error state."""

    name = f"filterpy {filterpy.__version__}"

    def __init__(self, model: PlainModel, nominal: Nominal, covariance: np.ndarray) -> None:
        self.model, self.nominal = model, nominal
        self.core = ExtendedKalmanFilter(STATES, 3)
        self.core.x = np.zeros(STATES)
        self.core.P = covariance.copy()
        self._observe = np.eye(3, STATES)

    def predict(self, force: np.ndarray, rate: np.ndarray, dt: float) -> None:
        self.core.F = self.model.transition(self.nominal, force, dt)
        self.core.Q = self.model.noise * dt
        self.core.predict()
        self.nominal = self.model.move(self.nominal, force, rate, dt)

    def fix(self, position: np.ndarray, noise: np.ndarray) -> None:
        residual = position - self.nominal.vector[:3]
        self.core.update(residual, lambda x: self._observe, lambda x: x[:3], noise)
        self.nominal = self.nominal.plus(self.core.x)
        self.core.x = np.zeros(STATES)

    def position(self) -> np.ndarray:
        return self.nominal.vector[:3]


class NavlieRun:
    """navlie's extended Kalman filter on the manifold."""

    name = "navlie 0.0.1"

    def __init__(self, model: PlainModel, nominal: Nominal, covariance: np.ndarray) -> None:
        kinds, filters = _navlie()
        self._kinds = kinds
        state = _navlie_state(kinds, nominal, 0.0)
        self.core = filters.ExtendedKalmanFilter(_navlie_process(kinds, model))
        self.belief = kinds.StateWithCovariance(state, covariance.copy())
        self._input: Any = None
        self._sensor_kind = _navlie_sensor(kinds)
        self._stamp = 0.0

    def predict(self, force: np.ndarray, rate: np.ndarray, dt: float) -> None:
        self._stamp += dt
        sample = self._kinds.StampedValue(np.concatenate([force, rate]), self._stamp)
        self.belief = self.core.predict(self.belief, sample, dt)

    def fix(self, position: np.ndarray, noise: np.ndarray) -> None:
        measured = self._kinds.Measurement(position, self.belief.state.stamp, self._sensor_kind(noise))
        self.belief = self.core.correct(self.belief, measured, None)

    def position(self) -> np.ndarray:
        return np.asarray(self.belief.state.value.vector[:3])


def _navlie() -> tuple[Any, Any]:
    """navlie's types and filters, without the parts of it that need what is not published."""
    if "navlie" not in sys.modules:
        spec = importlib.util.find_spec("navlie")  # type: ignore[attr-defined]
        package = types.ModuleType("navlie")
        package.__path__ = list(spec.submodule_search_locations)
        sys.modules["navlie"] = package
    return importlib.import_module("navlie.types"), importlib.import_module("navlie.filters")


def _navlie_state(kinds: Any, nominal: Nominal, stamp: float) -> Any:
    class NominalState(kinds.State):
        def __init__(self, value: Nominal, stamp: float | None) -> None:
            super().__init__(value, STATES, stamp)

        def plus(self, dx: np.ndarray) -> Any:
            return NominalState(self.value.plus(np.ravel(dx)), self.stamp)

        def minus(self, x: Any) -> np.ndarray:
            return self.value.minus(x.value)

        def copy(self) -> Any:
            return NominalState(self.value.copy(), self.stamp)

    return NominalState(nominal, stamp)


def _navlie_process(kinds: Any, model: PlainModel) -> Any:
    class Strapdown(kinds.ProcessModel):
        def evaluate(self, x: Any, u: Any, dt: float) -> Any:
            moved = x.copy()
            moved.value = model.move(x.value, u.value[:3], u.value[3:], dt)
            return moved

        def jacobian(self, x: Any, u: Any, dt: float) -> np.ndarray:
            return model.transition(x.value, u.value[:3], dt)

        def covariance(self, x: Any, u: Any, dt: float) -> np.ndarray:
            return model.noise * dt

    return Strapdown()


def _navlie_sensor(kinds: Any) -> Any:
    class Position(kinds.MeasurementModel):
        def __init__(self, noise: np.ndarray) -> None:
            self.noise = noise
            self._observe = np.eye(3, STATES)

        def evaluate(self, x: Any) -> np.ndarray:
            return x.value.vector[:3]

        def jacobian(self, x: Any) -> np.ndarray:
            return self._observe

        def covariance(self, x: Any) -> np.ndarray:
            return self.noise

    return Position
