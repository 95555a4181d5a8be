"""The filter that runs sample by sample: any cutting and any saving give the same bits, damage is noticed, `track` agrees."""

from __future__ import annotations

import zlib
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    Complementary,
    Imu,
    InputError,
    JointCalibration,
    Mekf,
    OrientationFilter,
    calibrate_joint,
    simulate_ball_joint,
    track,
)
from numpy.typing import NDArray
from track_cases import apart_deg, known

Array = NDArray[np.float64]
VARIANTS: dict[str, Any] = {
    "mekf": Mekf(),
    "mekf single": Mekf(precision="single"),
    "mekf published": Mekf.as_published(),
    "complementary": Complementary(),
    "complementary single": Complementary(precision="single"),
    "complementary biases": Complementary(bias_gain=0.02, beta_extra=1.0),
    "complementary published": Complementary.as_published(),
}
KINDS = ("even", "timed", "gaps", "irregular")


@cache
def samples(kind: str) -> tuple[Any, ...]:
    if kind in ("even", "timed"):
        sim = simulate_ball_joint(seed=1, duration_s=14.0)
    elif kind == "gaps":
        sim = simulate_ball_joint(
            ("random", "random"), duration_s=7.0, transition_s=3.3, seed=2, packet_loss=0.02, burst_length=5.0
        )
    else:
        sim = simulate_ball_joint(time_s=np.cumsum(np.random.default_rng(3).uniform(0.004, 0.016, 1400)), seed=3)
    return sim.gyr1, sim.acc1, sim.gyr2, sim.acc2, None if kind == "even" else 77.0 + sim.time_s


def rows(kind: str, which: Any) -> tuple[Any, ...]:
    return tuple(None if a is None else a[which] for a in samples(kind))


def fresh(variant: str) -> OrientationFilter:
    started: OrientationFilter = VARIANTS[variant].start(known(), rate_hz=100.0)
    return started


@cache
def whole(kind: str, variant: str) -> tuple[Array, bytes]:
    running = fresh(variant)
    return running.update(*samples(kind)), running.state()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(KINDS),
    variant=st.sampled_from(list(VARIANTS)),
    sizes=st.lists(st.integers(-1, 300), min_size=1, max_size=12).filter(lambda sizes: sum(map(abs, sizes)) > 20),
    save_every=st.integers(1, 9),
)
def test_any_cutting_and_saving_gives_the_bits_of_the_whole(kind: str, variant: str, sizes: list[int], save_every: int) -> None:
    running, found, at, turn = fresh(variant), [], 0, 0
    while at < len(samples(kind)[0]):
        size = sizes[turn % len(sizes)]
        one = size == -1
        found.append(np.atleast_2d(running.update(*rows(kind, slice(at, at + 1) if one else slice(at, at + size)))))
        at += 1 if one else size
        turn += 1
        if turn % save_every == 0:
            running = OrientationFilter.restore(running.state())
    np.testing.assert_array_equal(np.concatenate(found), whole(kind, variant)[0])
    assert running.state() == whole(kind, variant)[1]


@pytest.mark.parametrize("variant", list(VARIANTS))
@pytest.mark.parametrize("kind", KINDS)
def test_one_by_one_gives_the_bits_of_the_whole(kind: str, variant: str) -> None:
    running, found = fresh(variant), []
    for k in range(len(samples(kind)[0])):
        gyr1, acc1, gyr2, acc2, time_s = rows(kind, k)
        found.append(running.update(gyr1, acc1, gyr2, acc2, None if time_s is None else np.array([time_s])))
        assert found[-1].shape == (4,)
    np.testing.assert_array_equal(np.array(found), whole(kind, variant)[0])
    assert running.state() == whole(kind, variant)[1]


@pytest.mark.parametrize("variant", ["mekf", "complementary"])
def test_every_point_can_be_saved(variant: str) -> None:
    running = fresh(variant)
    for k in range(0, 450, 3):
        restored = OrientationFilter.restore(running.state())
        assert (restored.status, restored.angle_std_deg, restored.restarts) == (
            running.status,
            running.angle_std_deg,
            running.restarts,
        )
        assert (restored.heading_power, restored.delay_s) == (running.heading_power, running.delay_s)
        now = rows("even", slice(k, k + 3))
        np.testing.assert_array_equal(restored.update(*now), running.update(*now))
        assert restored.state() == running.state()


def test_what_it_is_given_may_be_lists_or_other_arrays() -> None:
    expected = fresh("mekf").update(*rows("even", slice(0, 50)))
    arrays = rows("even", slice(0, 50))[:4]
    for kind in (list, np.asfortranarray, lambda a: a.tolist(), lambda a: np.repeat(a, 2, axis=0)[::2]):
        np.testing.assert_array_equal(fresh("mekf").update(*(kind(a) for a in arrays)), expected)
    assert fresh("mekf").update(*(np.zeros((0, 3)),) * 4).shape == (0, 4)


def test_times_may_be_a_number_for_one_sample() -> None:
    one, other = fresh("mekf"), fresh("mekf")
    for k in range(20):
        gyr1, acc1, gyr2, acc2, _ = rows("timed", k)
        a = one.update(gyr1, acc1, gyr2, acc2, 0.01 * k)
        np.testing.assert_array_equal(a, other.update(gyr1, acc1, gyr2, acc2, np.array([0.01 * k])))


BAD: dict[str, tuple[Any, ...]] = {
    "nan": (np.full((5, 3), np.nan), None),
    "infinite": (np.full((5, 3), np.inf), None),
    "huge": (np.full((5, 3), 1e10), None),
    "shape": (np.zeros((5, 4)), None),
    "length": (np.zeros((4, 3)), None),
    "text": ("gyr", None),
    "ragged": ([[1.0, 2.0], [3.0]], None),
    "time back": (np.zeros((5, 3)), np.array([0.0, 0.01, 0.02, 0.01, 0.03])),
    "time still": (np.zeros((5, 3)), np.zeros(5)),
    "time nan": (np.zeros((5, 3)), np.array([0.0, 0.01, np.nan, 0.03, 0.04])),
    "time length": (np.zeros((5, 3)), np.arange(4.0)),
    "time shape": (np.zeros((5, 3)), np.zeros((5, 1))),
    "time text": (np.zeros((5, 3)), "now"),
}


@pytest.mark.parametrize("name", list(BAD))
@pytest.mark.parametrize("variant", ["mekf", "complementary"])
def test_of_a_refused_block_nothing_is_taken(variant: str, name: str) -> None:
    gyr1, time_s = BAD[name]
    running = fresh(variant)
    fine = np.zeros((5, 3))
    if time_s is None:
        running.update(*rows("even", slice(0, 100)))
    state = running.state()
    with pytest.raises(InputError):
        running.update(gyr1, fine, fine, fine, time_s)
    assert running.state() == state


def test_times_go_on_and_come_with_every_call_or_with_none() -> None:
    running = fresh("mekf")
    running.update(*rows("timed", slice(0, 50)))
    for restored in (running, OrientationFilter.restore(running.state())):
        state = restored.state()
        with pytest.raises(InputError, match="increase"):
            restored.update(*rows("timed", slice(49, 60)))
        with pytest.raises(InputError, match="every call or with none"):
            restored.update(*rows("even", slice(50, 60)))
        assert restored.state() == state


@pytest.mark.parametrize("state", ["text", bytearray(b"x"), memoryview(b"x"), None, 1, [1, 2]])
def test_what_is_not_bytes_is_refused(state: Any) -> None:
    with pytest.raises(InputError, match="state"):
        OrientationFilter.restore(state)


@cache
def saved(variant: str) -> bytes:
    running = fresh(variant)
    running.update(*rows("even", slice(0, 900)))
    return running.state()


def refused(state: bytes) -> None:
    with pytest.raises(InputError, match="state"):
        OrientationFilter.restore(state)


CLOCK, HEAD = 44, 44 + 8 + 1 + 4
"""Where the clock ends; where version, kind and checksum end."""


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.data())
def test_cut_and_lengthened_states_are_refused(data: st.DataObject) -> None:
    state = saved(data.draw(st.sampled_from(list(VARIANTS))))
    refused(state[: data.draw(st.integers(0, len(state) - 1))])
    refused(state + data.draw(st.binary(min_size=1, max_size=9)))
    refused(data.draw(st.binary(max_size=100)))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.data())
def test_damage_behind_the_clock_is_noticed(data: st.DataObject) -> None:
    state = bytearray(saved(data.draw(st.sampled_from(["mekf", "complementary single"]))))
    for k in data.draw(st.lists(st.integers(CLOCK, len(state) - 1), min_size=1, max_size=4, unique=True)):
        state[k] ^= data.draw(st.integers(1, 255))
    refused(bytes(state))


def test_damage_to_the_clock_is_noticed() -> None:
    state = saved("mekf")
    passed = []
    for k in range(CLOCK):
        for bit in (0, 3, 6):
            damaged = state[:k] + bytes([state[k] ^ (1 << bit)]) + state[k + 1 :]
            try:
                OrientationFilter.restore(damaged)
            except InputError:
                continue
            passed.append((k, bit))
    assert not passed


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_forged_checksums_make_nothing_panic(data: st.DataObject) -> None:
    state = saved(data.draw(st.sampled_from(list(VARIANTS))))
    body = bytearray(state[HEAD:])
    for k in data.draw(st.lists(st.integers(0, len(body) - 1), min_size=1, max_size=6)):
        body[k] = data.draw(st.sampled_from([0, 1, 127, 128, 240, 255]))
    checksum = zlib.crc32(body).to_bytes(4, "little")
    assert zlib.crc32(state[HEAD:]).to_bytes(4, "little") == state[HEAD - 4 : HEAD]
    try:
        running = OrientationFilter.restore(state[: HEAD - 4] + checksum + bytes(body))
        running.update(*rows("even", slice(900, 1000)))
    except InputError:
        return


def test_a_state_is_of_one_method_and_precision() -> None:
    for variant in VARIANTS:
        restored = OrientationFilter.restore(saved(variant))
        assert restored.state() == saved(variant)
        expected = fresh(variant)
        expected.update(*rows("even", slice(0, 900)))
        now = rows("even", slice(900, 1400))
        np.testing.assert_array_equal(restored.update(*now), expected.update(*now))


@pytest.mark.parametrize("variant", ["mekf", "complementary", "mekf published", "complementary biases"])
@pytest.mark.parametrize("kind", ["even", "timed", "irregular"])
def test_track_after_the_start_is_the_online_filter_with_its_neighbours(variant: str, kind: str) -> None:
    """What the online filter says of a sample bridges its delay with the gyroscopes; `track` waits for the accelerations."""
    gyr1, acc1, gyr2, acc2, time_s = samples(kind)
    how: dict[str, Any] = {"rate_hz": 100.0} if time_s is None else {"time_s": time_s}
    imus = Imu(gyr1, acc1, **how), Imu(gyr2, acc2, **how)
    calibration = calibrate_joint(*imus)
    offline = track(*imus, calibration, VARIANTS[variant])
    running = VARIANTS[variant].start(calibration, rate_hz=imus[0].rate_hz)
    online = running.update(gyr1, acc1, gyr2, acc2, time_s)
    begun = int(offline.starting_s * imus[0].rate_hz) + 5
    assert apart_deg(offline.q_12, online)[begun:].max() < 3.0
    # Of the last sample neither knows more than the other.
    assert apart_deg(offline.q_12[-1], online[-1]) < 0.01
    assert offline.angle_std_deg[-1] == pytest.approx(running.angle_std_deg, rel=1e-6)
    assert offline.restarts == running.restarts


def test_before_the_start_it_says_that_it_is_starting() -> None:
    running = fresh("mekf")
    assert running.status == "starting"
    assert running.angle_std_deg > 90.0
    assert running.delay_s == pytest.approx(0.02)
    assert running.heading_power == 0.0
    seen = [running.status]
    for k in range(0, 1400, 10):
        running.update(*rows("even", slice(k, k + 10)))
        if running.status != seen[-1]:
            seen.append(running.status)
    assert seen == ["starting", "tracking"]
    assert running.heading_power > 0.0
    assert running.angle_std_deg < 2.0


@pytest.mark.parametrize("kind", [Mekf, Complementary])
@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"calibration": None}, "calibration"),
        ({"calibration": "joint.json"}, "calibration"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"rate_hz": -50.0}, "rate_hz"),
        ({"rate_hz": float("nan")}, "rate_hz"),
        ({"rate_hz": float("inf")}, "rate_hz"),
        ({"rate_hz": 1e9}, "rate_hz"),
        ({"rate_hz": "fast"}, "rate_hz"),
        ({"rate_hz": None}, "rate_hz"),
        ({"q_12": [1.0, 0.0, 0.0]}, "q_12"),
        ({"q_12": [2.0, 0.0, 0.0, 0.0]}, "q_12"),
        ({"q_12": "x"}, "q_12"),
        ({"angle_std_deg": 0.0}, "angle_std_deg"),
        ({"angle_std_deg": "x"}, "angle_std_deg"),
    ],
)
def test_a_start_is_checked_by_name(kind: Any, arguments: dict[str, Any], name: str) -> None:
    whole_start: dict[str, Any] = {"calibration": JointCalibration(), "rate_hz": 100.0} | arguments
    with pytest.raises(InputError, match=name):
        kind().start(whole_start.pop("calibration"), **whole_start)


@pytest.mark.parametrize("kind", [Mekf, Complementary])
@pytest.mark.parametrize("rate_hz", [1e-6, 1.0, 1e4, 9e8])
def test_odd_rates_make_nothing_panic(kind: Any, rate_hz: float) -> None:
    running = kind().start(known(), rate_hz=rate_hz)
    q = running.update(*rows("even", slice(0, 200)))
    assert np.isfinite(q).all()
    OrientationFilter.restore(running.state())


def test_memory_is_bounded() -> None:
    running = fresh("mekf")
    sizes = {len(running.state())}
    for _ in range(3):
        running.update(*rows("even", slice(0, 1400)))
        sizes.add(len(running.state()))
    assert max(sizes) < 10_000
