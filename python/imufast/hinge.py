"""Plug-and-play calibration of a hinge: strap two sensors on, move, and be told when the axis can be trusted."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.decide import Decider, Estimate, HingeStep, Past, Verdict
from imufast.errors import InputError, SettingsError
from imufast.imu import Imu
from imufast.pairs import check_pair
from imufast.samples import ReadOnly, as_array
from imufast.settings import HingeSettings, check_count, check_number, settings_from
from imufast.state import pack, unpack

__all__ = ["HingeCalibration", "HingeCalibrator", "calibrate_hinge"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HingeCalibration(ReadOnly):
    """A hinge axis as far as the motion has shown it, and whether to believe it.

    Attributes:
        verdict: HINGE, APPROXIMATE_HINGE, NOT_A_HINGE, NOT_ENOUGH_INFORMATION or MOUNTING_CHANGED.
        accepted: verdict HINGE or APPROXIMATE_HINGE, all bounds below their limit, and that for `n_consistent` estimates in a
            row. Later data may revoke it: a joint with two degrees of freedom that has so far turned about one axis only cannot
            be told from a hinge by anyone.
        accepted_at_s: when the present acceptance was granted, in the recording's time, s; None unless accepted.
        axis1, axis2: (3,) the latest axes in sensor frames 1 and 2, unit vectors with one common sign that never flips; None
            while there is no estimate at all.
        bound95_deg: (2,) bound meant to hold the angle between each axis and the truth in 95 % of cases, degrees: scatter of
            the estimate, biases, model error (atan of the misfit) and `floor_deg`; or None.
        misfit: rms of ‖gyr1×axis1‖ − ‖gyr2×axis2‖ over the rms relative rate about the axis, moving samples, low-passed; of
            all the past or of the last minute of motion, the larger; or None.
        covariance: (6, 6) of the stacked axes in sensor coordinates, rad², biases considered; or None.
        why: what stands in the way of acceptance, in words; empty when accepted.
        history: the steps, one every `step_s`; a stream keeps the latest ones.
        mounting_changed_at_s: when the mounting was seen to have changed, s; the axes belong to the time after the last.
        gyr_bias1, gyr_bias2: (3,) gyroscope biases that rest has shown, rad/s; or None.
        gyr_time_s, acc_time_s: times of the samples that the estimate rests on, s; empty in a stream.
        settings: what it was made with.
    """

    verdict: Verdict
    accepted: bool
    accepted_at_s: float | None
    axis1: Array | None
    axis2: Array | None
    bound95_deg: Array | None
    misfit: float | None
    covariance: Array | None = field(repr=False)
    why: tuple[str, ...]
    history: tuple[HingeStep, ...] = field(repr=False)
    mounting_changed_at_s: tuple[float, ...]
    gyr_bias1: Array | None = field(repr=False)
    gyr_bias2: Array | None = field(repr=False)
    gyr_time_s: Array = field(repr=False)
    acc_time_s: Array = field(repr=False)
    settings: HingeSettings = field(repr=False)


class HingeCalibrator:
    """Calibrates a hinge from a stream, in bounded memory, for as long as it runs.

    Samples may come one by one or in blocks; however they are cut, the results are the same bits. Estimates are made every
    `settings.step_s` of recording time, and only when the selection has changed; once accepted, when at least a fiftieth of it
    is new. Misfit and mounting are watched at every step.

    Args:
        rate_hz: nominal rate of the samples, Hz.
        settings: a `HingeSettings`; default `HingeSettings()`.
        keep_steps: how many steps `history` keeps. Default 3600, an hour.
        **keywords: fields of `HingeSettings`; they win over `settings`.

    Raises:
        InputError: rate_hz or keep_steps is not a positive number.
        SettingsError: an unknown setting or one out of its range.
    """

    def __init__(
        self, rate_hz: float, *, settings: HingeSettings | None = None, keep_steps: int | None = 3600, **keywords: Any
    ) -> None:
        try:
            rate = check_number("rate_hz", rate_hz, 0.0, 1e9, low_open=True)
            kept = None if keep_steps is None else check_count("keep_steps", keep_steps, 1, 10_000_000)
        except SettingsError as error:
            raise InputError(str(error)) from None
        self._settings = settings_from(HingeSettings, settings, keywords)
        self._rate_hz = rate
        self._stream = _new_stream(self._rate_hz, self._settings)
        self._decider = Decider(self._settings)
        self._history: deque[HingeStep] = deque(maxlen=kept)
        self._estimate: Estimate | None = None
        self._draws = 0
        self._result: HingeCalibration | None = None

    def push(
        self, gyr1: ArrayLike, acc1: ArrayLike, gyr2: ArrayLike, acc2: ArrayLike, time_s: ArrayLike | None = None
    ) -> HingeCalibration:
        """Take samples and return the latest result.

        Args:
            gyr1, acc1, gyr2, acc2: (3,) one sample or (N, 3) a block, rad/s and m/s², in sensor frames.
            time_s: time of the sample or (N,) times, s, increasing also from call to call, any step; with every call or with
                none (then `rate_hz` is exact and nothing is lost).

        Raises:
            InputError: shapes that do not fit, values that are not finite, time that goes back. Nothing of the block is taken.
        """
        self._push(gyr1, acc1, gyr2, acc2, time_s)
        return self.result()

    def _push(self, gyr1: Any, acc1: Any, gyr2: Any, acc2: Any, time_s: Any) -> None:
        stream = self._stream
        try:
            taken = stream.push(gyr1, acc1, gyr2, acc2, time_s, 0)
        except (TypeError, ValueError):
            # Not arrays as the core wants them: convert, and let the core say what is wrong with the rest.
            gyr1, acc1, gyr2, acc2 = (
                as_array(name, a) for name, a in (("gyr1", gyr1), ("acc1", acc1), ("gyr2", gyr2), ("acc2", acc2))
            )
            time_s = None if time_s is None else np.atleast_1d(as_array("time_s", time_s))
            try:
                taken = stream.push(gyr1, acc1, gyr2, acc2, time_s, 0)
            except ValueError as error:
                raise InputError(str(error)) from None
        count = 1 if gyr1.ndim == 1 else len(gyr1)
        while taken < count:
            self._step()
            taken = stream.push(gyr1, acc1, gyr2, acc2, time_s, taken)

    def _step(self) -> None:
        stream, settings, decider = self._stream, self._settings, self._decider
        time_s = stream.next_step_s
        changed, selected = stream.changes
        drawn = settings.starts == "random"
        news = changed * 50 >= selected if decider.accepted else changed > 0
        if self._estimate is None or drawn or news:
            starts = None
            if drawn:
                # A seed of its own for every estimate, so that a restored stream draws what the first would have drawn.
                rng = np.random.default_rng([settings.seed, self._draws])
                starts = rng.normal(size=(settings.random_starts, 2, 3))
            self._draws += 1
            rested = settings.bias_from_rest and all(bias is not None for bias in stream.gyr_bias)
            gyr_std = settings.gyr_bias_rest_std if rested else settings.gyr_bias_std
            record = stream.estimate(gyr_std, settings.acc_bias_std, starts)
            self._estimate = None if record is None else Estimate.of(record)
        step = decider.step(self._estimate, time_s, stream)
        if self._estimate is None:
            step = replace(step, why=step.why + self._slow_samples())
        self._history.append(step)
        if decider.mounting_changed_at_s[-1:] == [time_s]:
            stream.restart()
            decider.start_over()
            self._estimate = None
        stream.next_step()
        self._result = None

    def _slow_samples(self) -> tuple[str, ...]:
        """A rate that is far from the truth makes every sample look like a gap: say so."""
        step_s = self._stream.mean_step_s
        if step_s is None or step_s * self._rate_hz < 1.5:
            return ()
        return (f"the samples come at {1.0 / step_s:.4g} Hz on average, not at rate_hz={self._rate_hz:g}",)

    def result(self) -> HingeCalibration:
        """The latest result, as `push` returns it."""
        if self._result is None:
            self._result = self._make_result()
        return self._result

    def _make_result(self, gyr_time_s: Array | None = None, acc_time_s: Array | None = None) -> HingeCalibration:
        step = self._history[-1] if self._history else None
        estimate = self._estimate
        biases = [None if bias is None else np.array(bias) for bias in self._stream.gyr_bias]
        return HingeCalibration(
            verdict=step.verdict if step else Verdict.NOT_ENOUGH_INFORMATION,
            accepted=bool(step and step.accepted),
            accepted_at_s=self._decider.accepted_at_s if step and step.accepted else None,
            axis1=step.axis1 if step else None,
            axis2=step.axis2 if step else None,
            bound95_deg=step.bound95_deg if step else None,
            misfit=step.misfit if step else None,
            covariance=np.array(estimate.covariance) if estimate else None,
            why=step.why if step else ("no step of estimation has passed yet",),
            history=tuple(self._history),
            mounting_changed_at_s=tuple(self._decider.mounting_changed_at_s),
            gyr_bias1=biases[0],
            gyr_bias2=biases[1],
            gyr_time_s=np.zeros(0) if gyr_time_s is None else gyr_time_s,
            acc_time_s=np.zeros(0) if acc_time_s is None else acc_time_s,
            settings=self._settings,
        )

    def state(self) -> bytes:
        """Everything it knows, as bytes of a stated version: `restore` goes on exactly where this stands."""
        decider = self._decider
        plain = {
            "rate_hz": self._rate_hz,
            "settings": asdict(self._settings),
            "keep_steps": self._history.maxlen,
            "draws": self._draws,
            "estimate": None if self._estimate is None else asdict(self._estimate),
            "history": [step.plain() for step in self._history],
            "decider": {name: getattr(decider, name) for name in _DECIDER_NUMBERS}
            | {
                "axes": None if decider.axes is None else [axis.tolist() for axis in decider.axes],
                "past": [asdict(past) for past in decider.past],
            },
        }
        return pack(_STATE_VERSION, plain, self._stream.state())

    @classmethod
    def restore(cls, state: bytes) -> HingeCalibrator:
        """The calibrator whose `state` this is. Raises InputError when the bytes are damaged or of another version."""
        plain, stream = unpack(_STATE_VERSION, state, "HingeCalibrator")
        try:
            self = cls(plain["rate_hz"], settings=HingeSettings(**plain["settings"]), keep_steps=plain["keep_steps"])
            self._stream = _core.HingeStream.restore(stream)
            self._draws = plain["draws"]
            self._estimate = None if plain["estimate"] is None else Estimate(**plain["estimate"])
            self._history.extend(HingeStep.from_plain(step) for step in plain["history"])
            saved = plain["decider"]
            for name in _DECIDER_NUMBERS:
                setattr(self._decider, name, saved[name])
            self._decider.axes = None if saved["axes"] is None else (np.array(saved["axes"][0]), np.array(saved["axes"][1]))
            self._decider.past.extend(Past(**past) for past in saved["past"])
        except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
            raise InputError(f"state cannot be restored ({error}): give the bytes that HingeCalibrator.state() gave") from None
        return self


_STATE_VERSION = b"imufast.HingeCalibrator\x01"
_DECIDER_NUMBERS = ("accepted_at_s", "mounting_changed_at_s", "run", "failed", "slipping", "last_seen")


def _new_stream(rate_hz: float, settings: HingeSettings) -> _core.HingeStream:
    published = settings.acceptance == "published"
    kernel = rate_hz / settings.lowpass_hz if settings.lowpass_hz else 0.0
    if max(kernel, settings.window_s * rate_hz) > 1e6:
        raise InputError(
            f"rate_hz={rate_hz:g} makes the windows of lowpass_hz={settings.lowpass_hz} and window_s={settings.window_s:g} "
            "longer than a million samples"
        )
    return _core.HingeStream(
        rate_hz=rate_hz,
        lowpass_hz=settings.lowpass_hz or 0.0,
        window_s=settings.window_s,
        max_samples=settings.max_samples,
        energy_threshold=settings.energy_threshold,
        always_quiet=not published,
        settle_pairing=not published,
        bias_from_rest=settings.bias_from_rest,
        max_iterations=settings.max_iterations,
        weight_ratio=settings.weight_ratio,
        rate_scale=settings.rate_scale,
        offset_prior=settings.offset_prior,
        step_s=settings.step_s,
    )


def calibrate_hinge(imu1: Imu, imu2: Imu, *, settings: HingeSettings | None = None, **keywords: Any) -> HingeCalibration:
    """Calibrate a hinge from a recording, as a wearer would have seen it step by step: Algorithms 1 to 4 of Olsson et al. 2020
    with deterministic starts, calibrated bounds and verdicts.

    The result is that of the end of the recording; `history` has every step. Motion that does not tell gives the verdict
    NOT_ENOUGH_INFORMATION, a joint that is no hinge NOT_A_HINGE, neither is an exception.

    Args:
        imu1, imu2: the sensors on the two segments, same time base. Any mounting.
        settings: a `HingeSettings`; default `HingeSettings()`, `HingeSettings.as_published()` for the paper's own.
        **keywords: fields of `HingeSettings`, such as `max_error_deg=3.0`, `n_consistent=10`; they win over `settings`.

    Raises:
        InputError: not two Imus of one time base, the same data twice, or too few samples.
        SettingsError: an unknown setting or one out of its range.
    """
    check_pair(imu1, imu2)
    calibrator = HingeCalibrator(imu1.rate_hz, settings=settings, keep_steps=None, **keywords)
    calibrator._push(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, imu1.time_s)
    gyr_time_s, acc_time_s = calibrator._stream.chosen_times()
    return calibrator._make_result(np.array(gyr_time_s), np.array(acc_time_s))
