"""`sensor_noise`: the white noise of simulated sensors comes back, also from motion, at any rate and across gaps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imufast import Imu, SensorNoise, simulate_ball_joint, simulate_hinge
from imufast.noise import sensor_noise

GYR, ACC = 0.004, 0.03


def simulated(kind: str, **settings: Any) -> Any:
    noise: dict[str, Any] = {"gyr_noise": GYR, "acc_noise": ACC, "seed": 2}
    if kind in ("random", "S3", "bend_y") or kind.startswith("ball"):
        return simulate_ball_joint(kind.removeprefix("ball "), **noise | settings)
    return simulate_hinge(kind, **noise | settings)


def ratios(noise: SensorNoise, gyr: float = GYR, acc: float = ACC) -> list[float]:
    return [noise.gyr_std1 / gyr, noise.gyr_std2 / gyr, noise.acc_std1 / acc, noise.acc_std2 / acc]


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("ball stationary", {"duration_s": 30.0}),
        ("ball stationary", {"duration_s": 30.0, "rate_hz": 1000.0}),
        ("ball stationary", {"duration_s": 300.0}),
        ("ball stationary", {"duration_s": 30.0, "packet_loss": 0.1}),
        ("random", {"duration_s": 60.0}),
        ("random", {"duration_s": 60.0, "rate_hz": 1000.0}),
        ("S3", {}),
        ("stiff", {"duration_s": 60.0}),
        ("sequential", {"duration_s": 60.0, "rate_hz": 100.0}),
    ],
)
def test_white_noise_comes_back_from_rest_and_from_slow_motion(kind: str, settings: dict[str, Any]) -> None:
    sim = simulated(kind, **settings)
    for ratio in ratios(sensor_noise(sim.imu1, sim.imu2)):
        assert 0.85 < ratio < 1.15


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_white_noise_comes_back_at_low_rates(rate_hz: float, seed: int) -> None:
    sim = simulated("ball stationary", duration_s=60.0, rate_hz=rate_hz, seed=seed)
    for ratio in ratios(sensor_noise(sim.imu1, sim.imu2)):
        assert 0.85 < ratio < 1.15


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_motion_is_not_taken_for_noise(rate_hz: float) -> None:
    sim = simulated("random", duration_s=60.0, rate_hz=rate_hz)
    for ratio in ratios(sensor_noise(sim.imu1, sim.imu2)):
        assert 0.9 < ratio < 1.1


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_it_scales_with_the_noise(factor: float) -> None:
    sim = simulated("ball stationary", duration_s=30.0, gyr_noise=factor * GYR, acc_noise=factor * ACC)
    for ratio in ratios(sensor_noise(sim.imu1, sim.imu2), factor * GYR, factor * ACC):
        assert 0.85 < ratio < 1.15


def test_each_sensor_has_its_own() -> None:
    sim = simulated("ball stationary", duration_s=30.0)
    rng = np.random.default_rng(0)
    noisy = Imu(sim.gyr2 + 0.04 * rng.normal(size=sim.gyr2.shape), sim.acc2 + 0.3 * rng.normal(size=sim.acc2.shape), 100.0)
    alone, found = sensor_noise(sim.imu1, sim.imu2), sensor_noise(sim.imu1, noisy)
    assert (found.gyr_std1, found.acc_std1) == (alone.gyr_std1, alone.acc_std1)
    assert found.gyr_std2 == pytest.approx(0.04, rel=0.15)
    assert found.acc_std2 == pytest.approx(0.3, rel=0.15)
    assert found.rate_hz == 100.0
    assert found.link_std is None


def test_mounting_biases_and_the_origin_of_time_change_nothing() -> None:
    sim = simulated("random", duration_s=20.0)
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    plain = sensor_noise(sim.imu1, sim.imu2)
    moved = Imu(sim.gyr1 @ turn.T + 0.02, sim.acc1 @ turn.T + 0.1, time_s=sim.time_s + 1024.0)
    other = Imu(sim.gyr2, sim.acc2, time_s=sim.time_s + 1024.0)
    found = sensor_noise(moved, other)
    np.testing.assert_allclose(ratios(found), ratios(plain), rtol=1e-6)


def test_nothing_is_differenced_across_gaps() -> None:
    # Rest before, rest in another pose after: the jump is no noise.
    one = simulated("ball stationary", duration_s=20.0)
    acc1 = one.acc1.copy()
    acc1[1000:] += 3.0
    time_s = one.time_s + 5.0 * (np.arange(2000) >= 1000)
    jumped = Imu(one.gyr1, acc1, time_s=time_s), Imu(one.gyr2, one.acc2, time_s=time_s)
    assert sensor_noise(*jumped).acc_std1 == pytest.approx(sensor_noise(one.imu1, one.imu2).acc_std1, rel=0.02)


@pytest.mark.parametrize("rows", [4, 5, 7, 50])
def test_very_short_recordings_give_numbers(rows: int) -> None:
    sim = simulated("ball stationary", duration_s=2.0)
    found = sensor_noise(sim.imu1[:rows], sim.imu2[:rows])
    assert np.isfinite(ratios(found)).all()
    assert min(ratios(found)) > 0.0


def test_every_second_sample_lost_gives_numbers() -> None:
    sim = simulated("ball stationary", duration_s=10.0)
    rows = np.sort(np.random.default_rng(0).permutation(1000)[:300])
    imus = [Imu(g[rows], a[rows], time_s=sim.time_s[rows]) for g, a in ((sim.gyr1, sim.acc1), (sim.gyr2, sim.acc2))]
    assert np.isfinite(ratios(sensor_noise(*imus))).all()


def test_it_is_frozen() -> None:
    noise = SensorNoise(0.001, 0.002, 0.01, 0.02, 100.0)
    with pytest.raises(AttributeError):
        noise.gyr_std1 = 1.0  # type: ignore[misc]
    assert noise == SensorNoise(0.001, 0.002, 0.01, 0.02, 100.0)
