"""Error-state extended Kalman filter on SO(3): predict, gate, weigh, update. It knows no sensor.

The covariance is that of the error defined in `state`, updated in Joseph's form (safe for any gain) and kept exactly
symmetric. After a correction the errors are expressed about the corrected estimate (`turn_of_correction`): that
matters when the first heading moves the estimate by tens of degrees, and over thousands of small corrections.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.process import Earth, ImuSample, ProcessModel, ProcessNoise
from bluerov_slam.navigation.state import ATTITUDE, NavEstimate, StateLayout, turn_of_correction

Array = NDArray[np.float64]

GATE_PROBABILITY = 0.999
"""A right measurement in a thousand is refused."""

HUBER_PROBABILITY = 0.95
"""Beyond the distance that 95 % of right measurements stay within, their noise is taken as larger (Huber's weight)."""

GAP_SHARE = 0.25
"""An IMU sample that begins this share of its interval after the estimate leaves a gap that is bridged."""


class Innovation(NamedTuple):
    """What a measurement says at an estimate: residual = measured - predicted (m,), H (m, n), noise R (m, m)."""

    residual: Array
    jacobian: Array
    noise: Array


class Measurement(Protocol):
    """One value of one sensor."""

    @property
    def sensor(self) -> str:
        """Name for gates and statistics."""

    @property
    def at_s(self) -> float:
        """When it was true."""

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """None: not usable in this state."""


@dataclass(frozen=True, slots=True)
class UpdateResult:
    """What became of one measurement. `nis` is that before any weight, about `dof` on average."""

    sensor: str
    at_s: float
    residual: Array
    innovation_covariance: Array
    nis: float
    dof: int
    weight: float
    accepted: bool


class Recorder(Protocol):
    """Takes what a smoother needs. Arrays but for the estimate and its covariance are the recorder's to keep."""

    def predicted(self, estimate: NavEstimate, covariance: Array, top: Array | None, decay: Array | None) -> None:
        """A prediction ended in this estimate and covariance; without a transition: the filter begins with them."""

    def updated(self, jacobian: Array, gain: Array, inverse: Array, residual: Array, turn: Array) -> None:
        """A measurement was used; `turn` (n, 3) as `turn_of_correction` has it."""

    def block_reset(self, place: slice) -> None:
        """What was known of these states was thrown away."""

    def errors_mixed(self, place: slice, other: slice, share: Array) -> None:
        """From here on the error at `place` contains `share` of that at `other` more than before."""

    def mark(self) -> Any:
        """Where `rewind` can go back to."""

    def rewind(self, mark: Any) -> None:
        """Forget what came after `mark`."""


class ErrorStateFilter:
    """Estimate and covariance. `covariance` (n, n) or standard deviations (n,) to begin with."""

    def __init__(
        self,
        estimate: NavEstimate,
        covariance: Array,
        noise: ProcessNoise | None = None,
        earth: Earth | None = None,
        recorder: Recorder | None = None,
    ) -> None:
        self.layout = estimate.layout
        self.estimate = estimate.copy()
        given = np.asarray(covariance, dtype=np.float64)
        self.covariance: Array = np.diag(given * given) if given.ndim == 1 else given.copy()
        if self.covariance.shape != (self.layout.size, self.layout.size):
            raise ValueError(f"covariance of shape {self.covariance.shape} for {self.layout.size} states")
        self.process = ProcessModel(self.layout, noise, earth)
        self.recorder = recorder
        self.refused_samples = 0
        """IMU samples that were no numbers or lay in the past."""
        self.refused_measurements = 0
        """Measurements that held no numbers or had no valid covariance."""
        if recorder is not None:
            recorder.predicted(self.estimate, self.covariance, None, None)

    @property
    def at_s(self) -> float:
        """The instant of the estimate."""
        return self.estimate.at_s

    def set_earth(self, earth: Earth) -> None:
        """Take another place on earth."""
        self.process = ProcessModel(self.layout, self.process.noise, earth)

    def predict_strapdown(self, sample: ImuSample) -> bool:
        """Move on to the end of the sample. False (and counted) if it holds no numbers or lies in the past.

        What lies between the estimate and the beginning of the sample is bridged without an IMU.
        """
        force, rate = sample.specific_force_frd_mps2, sample.angular_rate_frd_radps
        if not (sample.at_s > self.estimate.at_s and math.isfinite(sum(force.tolist()) + sum(rate.tolist()))):
            self.refused_samples += 1
            return False
        start_s = sample.at_s - sample.interval_s
        if start_s - self.estimate.at_s > GAP_SHARE * sample.interval_s:
            self.predict_kinematic(start_s)
        dt = sample.at_s - self.estimate.at_s
        top = self.process.strapdown(self.estimate, force, rate, dt)
        self.estimate.at_s = sample.at_s
        decay = self.process.propagate(self.covariance, top, dt)
        if self.recorder is not None:
            self.recorder.predicted(self.estimate, self.covariance, top, decay)
        return True

    def predict_kinematic(
        self,
        to_s: float,
        attitude_walk_rad_per_sqrt_s: float | None = None,
        velocity_walk_mps_per_sqrt_s: float | None = None,
    ) -> bool:
        """Move on without an IMU: velocity and attitude wander. False if `to_s` is not in the future."""
        dt = to_s - self.estimate.at_s
        if not dt > 0.0 or math.isinf(dt):
            return False
        noise = self.process.noise
        attitude, velocity = attitude_walk_rad_per_sqrt_s, velocity_walk_mps_per_sqrt_s
        attitude = noise.gap_attitude_walk_rad_per_sqrt_s if attitude is None else attitude
        velocity = noise.gap_velocity_walk_mps_per_sqrt_s if velocity is None else velocity
        top = self.process.kinematic(self.estimate, dt)
        self.estimate.at_s = to_s
        decay = self.process.propagate(self.covariance, top, dt, velocity, attitude)
        if self.recorder is not None:
            self.recorder.predicted(self.estimate, self.covariance, top, decay)
        return True

    def update(
        self,
        measurement: Measurement,
        gate_probability: float | None = GATE_PROBABILITY,
        robust: Literal["huber"] | None = "huber",
    ) -> UpdateResult | None:
        """Use a measurement as of now. None if it is not usable; `accepted` says whether it passed the gate."""
        innovation = measurement.evaluate(self.estimate, self.layout)
        if innovation is None:
            return None
        residual, jacobian, noise = innovation
        if not math.isfinite(float(residual.sum()) + float(jacobian.sum()) + float(noise.sum())):
            self.refused_measurements += 1
            return None
        dof = len(residual)
        carried = self.covariance @ jacobian.T
        predicted_noise = jacobian @ carried
        innovation_covariance = predicted_noise + noise
        inverse = _inverse(innovation_covariance)
        if inverse is None:
            self.refused_measurements += 1
            return None
        nis = float(residual @ inverse @ residual)
        if gate_probability is not None and nis > chi_square_quantile(gate_probability, dof):
            return UpdateResult(
                measurement.sensor, measurement.at_s, residual, innovation_covariance, nis, dof, 0.0, False
            )
        weight = 1.0
        if robust == "huber":
            limit = chi_square_quantile(HUBER_PROBABILITY, dof)
            if nis > limit:
                weight = math.sqrt(limit / nis)
                noise = noise / weight
                inverse = _inverse(predicted_noise + noise)
                if inverse is None:
                    self.refused_measurements += 1
                    return None
        self._correct(residual, jacobian, noise, carried, inverse)
        return UpdateResult(
            measurement.sensor, measurement.at_s, residual, innovation_covariance, nis, dof, weight, True
        )

    def reset_block(self, name: str, values: ArrayLike, std: ArrayLike) -> None:
        """Forget a block: these values, this standard deviation (or covariance), no correlation with anything.

        The attitude's value is a rotation matrix (`rotation_ned_frd`), its deviation about north, east and down.
        """
        place = self.layout[name]
        size = place.stop - place.start
        deviation = np.asarray(std, dtype=np.float64)
        block = deviation if deviation.ndim == 2 else np.diag(np.broadcast_to(deviation, (size,)) ** 2)
        value = np.asarray(values, dtype=np.float64)
        if not (np.isfinite(value).all() and np.isfinite(block).all()):
            raise ValueError(f"reset of {name} to {value} +- {deviation}")
        if name == "attitude":
            self.estimate.rotation_ned_frd = value.reshape(3, 3).copy()
        else:
            self.estimate.values[place] = value
        self.covariance[place, :] = 0.0
        self.covariance[:, place] = 0.0
        self.covariance[place, place] = block
        if self.recorder is not None:
            self.recorder.block_reset(place)

    def add_uncertainty(self, name: str, std: ArrayLike) -> None:
        """Let a block's variance grow by std^2; what it shares with others stays."""
        place = self.layout[name]
        size = place.stop - place.start
        self.covariance[place, place] += np.diag(np.broadcast_to(np.asarray(std, dtype=np.float64), (size,)) ** 2)

    def mix_errors(self, name: str, other: str, share: Array) -> None:
        """Let the error of a block become what it was plus `share` of another's: for a model whose scales changed."""
        place, source = self.layout[name], self.layout[other]
        self.covariance[place, :] += share @ self.covariance[source, :]
        self.covariance[:, place] += self.covariance[:, source] @ share.T
        if self.recorder is not None:
            self.recorder.errors_mixed(place, source, share)

    def std(self, name: str) -> Array:
        """Standard deviation of each state of a block."""
        place = self.layout[name]
        deviation: Array = np.sqrt(self.covariance.diagonal()[place])
        return deviation

    def is_healthy(self) -> bool:
        """Whether estimate and covariance are numbers, and every variance is above zero."""
        return self.estimate.is_finite() and bool(
            np.isfinite(self.covariance).all() and (self.covariance.diagonal() > 0.0).all()
        )

    def _seen_on_board(self, jacobian: Array) -> bool:
        """Whether a measurement is blind to a turn of heading, velocity and current together, and to the position."""
        values = self.estimate.values
        blind = jacobian[:, 8] - jacobian[:, 3] * values[4] + jacobian[:, 4] * values[3]
        if "current" in self.layout:
            place = self.layout.places["current"].start
            blind = blind - jacobian[:, place] * values[place + 1] + jacobian[:, place + 1] * values[place]
        return bool(np.abs(blind).max() < 1e-9) and not jacobian[:, :2].any()

    def _correct(self, residual: Array, jacobian: Array, noise: Array, carried: Array, inverse: Array) -> None:
        """Joseph's form: with A = P - K H P it is A (1 - K H)' + K R K' = A - (A H' - K R) K'."""
        gain = carried @ inverse
        error = gain @ residual
        covariance = self.covariance
        along = error if self._seen_on_board(jacobian) else covariance[:, 8] * (error[8] / covariance[8, 8])
        covariance -= gain @ carried.T
        covariance -= (covariance @ jacobian.T - gain @ noise) @ gain.T
        turn = turn_of_correction(self.layout, error, along)
        self.estimate.add_error(error)
        covariance += turn @ covariance[ATTITUDE]
        covariance += covariance[:, ATTITUDE] @ turn.T
        covariance += covariance.T.copy()
        covariance *= 0.5
        if self.recorder is not None:
            self.recorder.updated(jacobian, gain, inverse, residual, turn)


def _inverse(covariance: Array) -> Array | None:
    """Inverse of an innovation covariance; None if it is not positive definite."""
    if covariance.shape == (1, 1):
        value = float(covariance[0, 0])
        return np.array([[1.0 / value]]) if value > 0.0 else None
    try:
        factor = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        return None
    inverse: Array = factor.T @ factor
    return inverse
