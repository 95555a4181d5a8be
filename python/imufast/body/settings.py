"""What is known of bodies beforehand, and how sure the lower-body estimate is of its sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

from imufast.errors import SettingsError
from imufast.settings import Checked, check_number

__all__ = ["Anthropometry", "LowerBodySettings"]

USUAL_M = {"femur_m": (0.394, 0.030), "tibia_m": (0.411, 0.026), "hips_m": (0.187, 0.009)}
"""Lengths of the population, mean and standard deviation, m (Table 2, ANSUR II)."""
PAIRS = ("femur_m", "tibia_m", "hips_m", "femur_axis_deg", "tibia_axis_deg")


@dataclass(frozen=True, kw_only=True)
class Anthropometry:
    """Lengths and angles of a subject, as (mean, standard deviation); defaults are those of McGrath & Stirling 2020.

    Lengths that are left at their defaults follow those that are told, in proportion, as uncertain as these and half the
    population's spread make them: a femur of 0.30 m is a child's, whose tibia is not an adult's.

    Args:
        femur_m: hip to knee, m; default (0.394, 0.030), Table 2 (ANSUR II).
        tibia_m: knee to ankle, m; default (0.411, 0.026).
        hips_m: between the hips, m; default (0.187, 0.009).
        femur_axis_deg: angle of the knee's axis, pointing to the right, with the right femur from knee to hip, degrees; default
            (84, 2.4), Table 1 (Hollister 1993). The left leg is its mirror image, 180 less that.
        tibia_axis_deg: with the right tibia from ankle to knee, degrees; default (92, 1.2).
        femur_difference_m, tibia_difference_m: standard deviation of right against left, m; default 0.008 and 0.006 (2.2.7).
        limits: whether lengths beyond those of nearly every adult are pushed back (eq. 14: femur 0.326 to 0.480, tibia 0.344
            to 0.479, hips up to 0.409 m); default True. Never where the lengths told are more than 15 % off an adult's.

    Raises:
        SettingsError: a value that is no pair of numbers in range; the message names it.
    """

    femur_m: tuple[float, float] = USUAL_M["femur_m"]
    tibia_m: tuple[float, float] = USUAL_M["tibia_m"]
    hips_m: tuple[float, float] = USUAL_M["hips_m"]
    femur_axis_deg: tuple[float, float] = (84.0, 2.4)
    tibia_axis_deg: tuple[float, float] = (92.0, 1.2)
    femur_difference_m: float = 0.008
    tibia_difference_m: float = 0.006
    limits: bool = True

    def __post_init__(self) -> None:
        for name in PAIRS:
            pair = getattr(self, name)
            if not isinstance(pair, (tuple, list)) or len(pair) != 2:
                raise SettingsError(f"{name} must be (mean, standard deviation), got {pair!r}")
            low, high = (0.02, 2.0) if name.endswith("_m") else (45.0, 135.0)
            mean = check_number(f"{name}[0]", pair[0], low, high)
            std = check_number(f"{name}[1]", pair[1], 1e-4, 1e3)
            object.__setattr__(self, name, (mean, std))
        for name in ("femur_difference_m", "tibia_difference_m"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), 1e-4, 1e3))
        if not isinstance(self.limits, bool):
            raise SettingsError(f"limits must be True or False, got {self.limits!r}")
        self._in_proportion()

    def _in_proportion(self) -> None:
        """Sets the lengths that are not told."""
        told = {name: getattr(self, name) for name, usual in USUAL_M.items() if getattr(self, name) != usual}
        if not told:
            return
        sizes = [mean / USUAL_M[name][0] for name, (mean, _) in told.items()]
        # People of one size differ by half the population's spread.
        weights = [USUAL_M[name][0] ** 2 / (std**2 + (0.5 * USUAL_M[name][1]) ** 2) for name, (_, std) in told.items()]
        size = sum(size * weight for size, weight in zip(sizes, weights, strict=True)) / sum(weights)
        for name, (usual, spread) in USUAL_M.items():
            if name not in told:
                std = math.hypot(0.5 * spread, usual / math.sqrt(sum(weights)))
                # A length that is told as next to unknown makes no other less certain than the population's.
                object.__setattr__(self, name, (size * usual, min(std, spread + usual * abs(size - 1.0))))
        object.__setattr__(self, "limits", self.limits and all(ADULT[0] < size < ADULT[1] for size in sizes))

    @classmethod
    def of_height(cls, height_m: float) -> Anthropometry:
        """For a subject of this height, m: lengths in proportion to height, with half the population's spread.

        Raises:
            SettingsError: a height outside 0.8 to 2.5 m.
        """
        scale = check_number("height_m", height_m, 0.8, 2.5) / MEAN_HEIGHT_M
        usual = cls()
        femur, tibia, hips = ((scale * mean, 0.5 * std) for mean, std in (usual.femur_m, usual.tibia_m, usual.hips_m))
        return cls(femur_m=femur, tibia_m=tibia, hips_m=hips)


ADULT = (0.85, 1.15)
"""Sizes between which the limits hold, of the usual one."""
MEAN_HEIGHT_M = 1.69
"""Of the population of Table 2 (ANSUR II, both sexes alike)."""


@dataclass(frozen=True, kw_only=True)
class LowerBodySettings(Checked):
    """How the lower body is estimated. Standard deviations; small trusts, large forgives.

    Args:
        key_step_s: time between two moments of the estimate, s; small costs time and memory in proportion. Default 0.1.
        bridge_s: gaps up to this length are bridged by the cubic through the samples around them, with the noise that costs, s;
            beyond, only the body's constants and the biases are carried across. Default 0.3.
        gyr_noise, acc_noise: white noise of the sensors, rad/s/√Hz and m/s²/√Hz; defaults 5e-4 and 5e-3 (MEMS, with what
            integration adds).
        gyr_walk, acc_walk: random walk of the biases, rad/s/√s and m/s²/√s; defaults 2e-5 and 2e-4.
        gyr_bias_std, acc_bias_std: of each bias channel around what `track` finds, rad/s and m/s²; defaults 0.005 and 0.1.
        hip_std_m, knee_std_m, ankle_std_m: how far apart the sensors on either side may see a joint, m: soft tissue that does
            not follow the flexion in proportion. Defaults 0.03, 0.013, 0.01. Where a recording sees a joint less far apart than
            that while it moves, as much less is taken, down to half. These and the next two are of residuals 0.1 s apart,
            whatever `key_step_s`.
        hinge_std: rate of a knee across its axis, rad/s, besides what the gyroscopes scatter by at that moment; default 0.5.
        axes_std_deg: how far the knee's axis in the shank may stand off that in the thigh, degrees; None: not asked, as the
            paper does. Default 7.
        soft_tissue_deg, soft_tissue_m: how far, about and along each axis, skin and straps turn a thigh's or shank's sensor on
            its bone and shift it per radian of flexion of knee and hip. It moves the joints' centres in the sensors, which are
            estimated so; angles stay those of the sensors, and half of this, degrees and m, widens their bands: a leg is
            bent by half a radian more or less than on average. Defaults 3 and 0.01; both 0: sensors sit on bone.
        rest_acc_std: how much the first sensor, the pelvis's, is accelerated where no sensor turns faster than 0.3 rad/s, along
            each axis, m/s²; inf: not asked, as the paper does. Default 0.3: in sitting and standing much less, by its sway.
        center_std_m: joint centres around what `track` finds, m; default 0.1.
        tail: degrees of freedom of Student's t for joints and hinges; inf: Gaussian. Default 5.
        max_iterations: linear systems to solve. Default 120: ten to forty where the motion shows all headings, up to a hundred
            where feet rest or samples are lost.
        window_s: recordings longer than 2.5 of these, recorded time, are solved in overlapping windows this long, s, with joint
            centres and knee axes from the most informative two windows' worth; large costs memory and forgets nothing.
            Default 120.
        tolerance: the search ends where a step promises less than this in log-likelihood, or less than a millionth of the
            cost. Default 1e-3.

    Raises:
        SettingsError: a value out of its range.
    """

    key_step_s: float = 0.1
    bridge_s: float = 0.3
    gyr_noise: float = 5e-4
    acc_noise: float = 5e-3
    gyr_walk: float = 2e-5
    acc_walk: float = 2e-4
    gyr_bias_std: float = 0.005
    acc_bias_std: float = 0.1
    hip_std_m: float = 0.03
    knee_std_m: float = 0.013
    ankle_std_m: float = 0.01
    hinge_std: float = 0.5
    axes_std_deg: float | None = 7.0
    soft_tissue_deg: float = 3.0
    soft_tissue_m: float = 0.01
    rest_acc_std: float = 0.3
    center_std_m: float = 0.1
    tail: float = 5.0
    max_iterations: int = 120
    window_s: float = 120.0
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        ranges = {
            "key_step_s": (0.01, 1.0),
            "bridge_s": (0.0, 2.0),
            "gyr_noise": (1e-6, 1.0),
            "acc_noise": (1e-5, 10.0),
            "gyr_walk": (1e-8, 1.0),
            "acc_walk": (1e-7, 10.0),
            "gyr_bias_std": (1e-6, 1.0),
            "acc_bias_std": (1e-5, 10.0),
            "hip_std_m": (1e-4, 1.0),
            "knee_std_m": (1e-4, 1.0),
            "ankle_std_m": (1e-4, 1.0),
            "hinge_std": (1e-3, 100.0),
            "axes_std_deg": (0.1, 90.0),
            "soft_tissue_deg": (0.0, 90.0),
            "soft_tissue_m": (0.0, 1.0),
            "rest_acc_std": (1e-3, math.inf),
            "center_std_m": (1e-3, math.inf),
            "tail": (1.0, math.inf),
            "window_s": (5.0, math.inf),
            "tolerance": (1e-9, 10.0),
        }
        for name, (low, high) in ranges.items():
            if name != "axes_std_deg" or self.axes_std_deg is not None:
                self._number(name, low, high)
        self._count("max_iterations", 1, 10_000)
