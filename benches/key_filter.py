"""A self-calibrating filter of relative orientation, studied in `self_calibrating.py`; numpy, no part of the package.

A tenth of a second apart, *keys* hold what both sensors say, averaged over 0.2 s in the sensor's own frame at the key:
`f_i = A_i − B_i b_a,i − C_i(b_g,i) r_i` is the acceleration of the joint centre (as in the smoother, `kernel.rs` and
`keys.rs`). The link is `e = f_1 − R f_2` with `R = R_12`, perturbed on the right, and eighteen constants: r_1, r_2 (from the
joint centre to the sensor, m), accelerometer biases (m/s²), gyroscope biases (rad/s).

It starts from the latest keys at once: Wahba's problem and Gauss-Newton with one rotation for all of them and constants of zero
to begin with; then a Kalman pass about that trajectory, with the gyroscopes' drift, gives the mean and the covariance that
the filter goes on from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ONE = np.eye(3)
CONSTANTS_STD = np.repeat([0.5, 0.3, 0.02], 6)
"""Of r_1, r_2 (m), accelerometer biases (m/s²) and gyroscope biases (rad/s) beforehand."""
WALKS = np.repeat([2e-4, 1e-3, 1e-4], 6)
"""By how much these wander, the same units in √s."""
OPEN_VARIANCE = 2.5
"""Of each angle beforehand, rad²."""
WINDOW_S, KEY_S = 0.2, 0.1
TAIL = 4.0
"""Degrees of freedom of the Student t of the start's residuals."""
LEAST_LINK, LEAST_DRIFT, MOST_DRIFT = 0.005, 3e-4, 0.03
"""Of the link, m/s², and of the gyroscopes, rad/√s."""
LIMIT = 5.0
"""Squared normalised innovation from which on a link counts less."""
LINK_S, DRIFT_RATE, SIZE_S = 4.0, 0.5, 2.0
"""How fast link and drift adapt: s, 1/s, s."""
REST_KEYS, REST_TURN, REST_RATE, REST_ACC = 10, 0.015, 0.05, 0.15
"""A sensor is at rest where over so many keys its rate and acceleration range over less than this, rad/s and m/s², and it turns
more slowly than this, rad/s."""
REST_STD = 0.006
"""How well one key at rest shows the gyroscope bias, rad/s."""
LEAST_KEYS, MOST_KEYS, EVERY_KEYS = 30, 200, 10
"""A start looks at 3 to 20 s, once a second."""


@dataclass(frozen=True)
class Settings:
    """Of the filter.

    Attributes:
        start_std: a start is believed when two in a row agree and the second knows the orientation to this, rad.
        independent_links: no more links than these count as independent in the stated covariance, however many there were.
    """

    start_std: float = math.radians(2.0)
    independent_links: float = math.inf


def cross_matrix(v: Array) -> Array:
    """(..., 3) to (..., 3, 3): `cross_matrix(a) @ b` is a × b."""
    rows = np.zeros((*v.shape, 3))
    rows[..., 0, 1], rows[..., 0, 2], rows[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return rows - np.swapaxes(rows, -1, -2)


def exp(v: Array) -> Array:
    """Rotation matrices of rotation vectors."""
    angle = np.sqrt((v * v).sum(axis=-1))[..., None, None]
    cross, half = cross_matrix(v), np.sinc(angle / (2.0 * np.pi))
    return np.asarray(ONE + np.sinc(angle / np.pi) * cross + 0.5 * half * half * (cross @ cross))


def log(r: Array) -> Array:
    """Rotation vector of one rotation matrix."""
    twist = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = float(np.linalg.norm(twist))
    return twist if sine < 1e-9 else twist * (math.atan2(sine, 0.5 * (np.trace(r) - 1.0)) / sine)


def window(reach: int, step_s: float) -> tuple[Array, Array]:
    """Weights `cos⁴` of an average, and of the same average of a second derivative, exact for t⁰ to t⁴ (1/s²)."""
    half_s = (reach + 1) * step_s
    x = np.arange(-reach, reach + 1) * step_s / half_s
    cos, sin = np.cos(0.5 * np.pi * x), np.sin(0.5 * np.pi * x)
    average = cos**4
    curvature = (0.5 * np.pi) ** 2 * (12.0 * cos**2 * sin**2 - 4.0 * cos**4)
    average, curvature = average / average.sum(), curvature / average.sum()
    powers = x[:, None] ** np.arange(5)
    due = np.array([0.0, 0.0, 2.0, 6.0 * (x @ average), 12.0 * (x**2 @ average)])
    curvature = curvature + powers @ np.linalg.solve(powers.T @ powers, due - powers.T @ curvature)
    return average, curvature / half_s**2


@dataclass(frozen=True, eq=False)
class Keys:
    """What both sensors (first axis) say at K keys, each in its own frame there.

    Attributes:
        sample: (K,) index of each key's sample.
        acc, bias, lever: A (2, K, 3), B and C (2, K, 3, 3), the window's averages.
        rate: (2, K, 3) mean rate in the window, rad/s.
        turn, turned: (2, K, 3, 3) the rotation from the key before, and `∫Q dt` over it in the frame of the key before, s.
        share: (K,) weight of the link, 0 to 1: rows that repeat the one before are lost packets.
    """

    sample: NDArray[np.int64]
    acc: Array
    bias: Array
    lever: Array
    rate: Array
    turn: Array
    turned: Array
    share: Array

    def __len__(self) -> int:
        return len(self.sample)

    def part(self, begin: int, end: int) -> Keys:
        """Some of them."""
        both = (self.acc, self.bias, self.lever, self.rate, self.turn, self.turned)
        acc, bias, lever, rate, turn, turned = (x[:, begin:end] for x in both)
        return Keys(self.sample[begin:end], acc, bias, lever, rate, turn, turned, self.share[begin:end])

    @classmethod
    def of(cls, gyr: tuple[Array, Array], acc: tuple[Array, Array], rate_hz: float) -> Keys:
        """Of samples (N, 3) that are even in time."""
        step_s, reach, apart = 1.0 / rate_hz, max(2, round(0.5 * WINDOW_S * rate_hz)), max(1, round(KEY_S * rate_hz))
        place = np.arange(max(reach, apart), len(gyr[0]) - reach, apart)
        average, curvature = window(reach, step_s)
        seen: list[tuple[Array, ...]] = []
        fresh = np.zeros(len(gyr[0]))
        for raw_rate, raw_acc in zip(gyr, acc, strict=True):
            held = np.r_[False, ((np.diff(raw_rate, axis=0) == 0.0) & (np.diff(raw_acc, axis=0) == 0.0)).all(axis=1)]
            fresh += 0.5 * ~held
            g, a = bridged(raw_rate, held), bridged(raw_acc, held)
            step = steps(g, step_s)
            q = np.broadcast_to(ONE, (len(place), 3, 3))
            at = {0: q}
            for j in range(1, reach + 1):
                at[j] = at[j - 1] @ step[place + j]
                at[-j] = at[1 - j] @ np.swapaxes(step[place - j + 1], -1, -2)
            mean_acc, mean_rate = np.zeros((2, len(place), 3))
            bias, lever = np.zeros((2, len(place), 3, 3))
            for (j, weight), bend in zip(enumerate(average, -reach), curvature, strict=True):
                mean_acc += weight * (at[j] @ a[place + j][..., None])[..., 0]
                mean_rate += weight * (at[j] @ g[place + j][..., None])[..., 0]
                bias += weight * at[j]
                lever += bend * at[j]
            turned = np.zeros((len(place), 3, 3))
            for j in range(1 - apart, 1):
                further = q @ step[place + j]
                turned += 0.5 * step_s * (q + further)
                q = further
            seen.append((mean_acc, bias, lever, mean_rate, q, turned))
        share = np.array([fresh[k - reach : k + reach + 1].mean() ** 2 for k in place])
        mean_acc, bias, lever, mean_rate, q, turned = (np.stack(pair) for pair in zip(*seen, strict=True))
        shares = np.where(share > 0.3, share, 0.0)
        return cls(place, mean_acc, bias, lever, mean_rate, q, turned, shares)


def bridged(rows: Array, held: NDArray[np.bool_]) -> Array:
    """Straight lines in place of repeated rows."""
    if held.all() or not held.any():
        return rows
    number = np.arange(len(rows))
    return np.stack([np.interp(number, number[~held], column[~held]) for column in rows.T], axis=1)


def steps(gyr: Array, step_s: float) -> Array:
    """Rotation from the sample before to each: cubic through four rates, and `ω × ω dt²/12` for an axis that moves."""
    turn = np.zeros_like(gyr)
    turn[1:] = 0.5 * (gyr[1:] + gyr[:-1])
    turn[2:-1] = (13.0 * (gyr[1:-2] + gyr[2:-1]) - gyr[:-3] - gyr[3:]) / 24.0
    turn *= step_s
    turn[1:] += np.cross(gyr[:-1], gyr[1:]) * (step_s * step_s / 12.0)
    return exp(turn)


def seen_by(keys: Keys, sensor: int, x: Array) -> tuple[Array, Array]:
    """f (K, 3) of one sensor, and its derivative by that sensor's r, b_a, b_g (K, 3, 9).

    A gyroscope bias changes `K r = C r` as it changes ω in `ω × (ω × r)`; ω̇ does not know of it.
    """
    r, acc_bias, gyr_bias = (x[k + 3 * sensor : k + 3 * sensor + 3] for k in (0, 6, 12))
    rate = keys.rate[sensor]
    o, b, cross_r = cross_matrix(rate), cross_matrix(gyr_bias), cross_matrix(r)
    lever = keys.lever[sensor] - (o @ b + b @ o) + b @ b
    f = keys.acc[sensor] - keys.bias[sensor] @ acc_bias - lever @ r
    by_gyr_bias = -(o @ cross_r) - cross_matrix(np.cross(rate, r)) + cross_matrix(b @ r) + b @ cross_r
    return f, np.concatenate([-lever, -keys.bias[sensor], by_gyr_bias], axis=2)


def turns(keys: Keys, sensor: int, x: Array) -> Array:
    """(K, 3, 3) from the key before to each, without the gyroscope bias."""
    return np.asarray(exp(-(keys.turned[sensor] @ x[12 + 3 * sensor : 15 + 3 * sensor])) @ keys.turn[sensor])


def place_of(sensor: int) -> list[int]:
    """Where a sensor's r, b_a and b_g stand among the 21 unknowns."""
    return [3 + block + 3 * sensor + axis for block in (0, 6, 12) for axis in range(3)]


def residuals(keys: Keys, w: Array, x: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """Link residuals (K, 3) in the frame of sensor 1 at the last key, where R is `w`, derivatives (K, 3, 21), and both f."""
    to_last: list[Array] = []
    felt: list[tuple[Array, Array]] = []
    gyr_jacobian: list[Array] = []
    for sensor in (0, 1):
        turn = turns(keys, sensor, x)
        q = np.empty_like(turn)
        q[-1] = ONE
        for k in range(len(keys) - 1, 0, -1):
            q[k - 1] = q[k] @ turn[k].T
        # What a gyroscope bias turns between a key and the last one.
        drift = np.zeros_like(q)
        drift[:-1] = np.cumsum((q[:-1] @ keys.turned[sensor][1:])[::-1], axis=0)[::-1]
        f, jacobian = seen_by(keys, sensor, x)
        to_last.append(q)
        felt.append(((q @ f[..., None])[..., 0], q @ jacobian))
        gyr_jacobian.append(drift)
    (f1, j1), (f2, j2) = felt
    h = np.zeros((len(keys), 3, 21))
    h[:, :, :3] = w @ cross_matrix(f2)
    h[:, :, place_of(0)], h[:, :, place_of(1)] = j1, -(w @ j2)
    h[:, :, 15:18] -= cross_matrix(f1) @ gyr_jacobian[0]
    h[:, :, 18:21] += w @ cross_matrix(f2) @ gyr_jacobian[1]
    return f1 - f2 @ w.T, h, (f1, f2)


def wahba(f1: Array, f2: Array) -> Array:
    """The rotation that turns f2 best onto f1."""
    u, _, vt = np.linalg.svd(f1.T @ f2)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def scale_of(squares: Array) -> float:
    """Scale of a Student t in three dimensions from squared lengths."""
    variance = float(squares.mean()) / 3.0
    for _ in range(15):
        variance = max(float(((TAIL + 3.0) / (TAIL + squares / variance) * squares).mean()) / 3.0, 1e-4)
    return math.sqrt(variance)


def descend(keys: Keys, w: Array, x: Array) -> tuple[float, Array, Array, float]:
    """Damped Gauss-Newton from w and x: cost, both, and the scale of the residuals."""
    used = keys.share > 0.0

    def cost(e: Array, x: Array, scale: float) -> float:
        u = ((e * e).sum(axis=1) * keys.share)[used] / scale**2
        return float(((TAIL + 3.0) * np.log1p(u / TAIL) + 6.0 * math.log(scale)).sum() + ((x / CONSTANTS_STD) ** 2).sum())

    damping, scale, now = 0.0, 1.0, math.inf
    e, h, _ = residuals(keys, w, x)
    for _ in range(25):
        squares = (e * e).sum(axis=1) * keys.share
        scale = scale_of(squares[used])
        now = cost(e, x, scale)
        weight = (TAIL + 3.0) / (TAIL + squares / scale**2) / scale**2 * keys.share
        rows = h.reshape(-1, 21)
        weighted = (h * weight[:, None, None]).reshape(-1, 21)
        normal, slope = weighted.T @ rows, weighted.T @ e.ravel()
        normal += np.diag(np.r_[np.full(3, 1.0 / OPEN_VARIANCE), CONSTANTS_STD**-2.0])
        slope[3:] += x / CONSTANTS_STD**2
        for _ in range(8):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
            next_w, next_x = w @ exp(step[:3]), x + step[3:]
            tried = residuals(keys, next_w, next_x)
            if cost(tried[0], next_x, scale) <= now + 1e-9:
                break
            damping = max(10.0 * damping, 1e-3)
        else:
            break
        w, x, (e, h, _) = next_w, next_x, tried
        if np.linalg.norm(step[:3]) < 1e-4 and damping < 1e-2:
            break
        damping = 0.1 * damping if damping > 1e-4 else 0.0
    return now, w, x, scale


def at_rest(keys: Keys, sensor: int, k: int) -> bool:
    """Whether a sensor has been at rest up to key k."""
    if k < REST_KEYS:
        return False
    rate, acc = keys.rate[sensor, k - REST_KEYS : k + 1], keys.acc[sensor, k - REST_KEYS : k + 1]
    still = np.ptp(rate, axis=0).max() < REST_TURN and np.ptp(acc, axis=0).max() < REST_ACC
    return bool(still and np.abs(rate).max() < REST_RATE)


class KeyFilter:
    """The filter: R (3, 3), the constants x (18,) and the covariance of both (21, 21).

    While `frozen`, derivatives stay those of R and x, and what is learned adds up in `offset` (21,): one Gauss-Newton step.
    """

    def __init__(self, r: Array, x: Array, covariance: Array, settings: Settings, link: float, drift: float) -> None:
        self.r, self.x, self.covariance, self.settings = r, x, covariance, settings
        self.link_variance, self.drift = link * link, drift
        self.offset, self.frozen = np.zeros(21), False
        self.alike = 1.0
        self._past, self._correlation = np.zeros(3), [0.0, 0.0]
        self._correction, self._sizes = np.zeros(3), [0.0, 0.0]
        self._shown, self._scatter, self._count = np.zeros((3, 3)), 0.0, 0

    def predict(self, keys: Keys, k: int) -> None:
        """From the key before k to k: by the gyroscopes."""
        one = keys.part(k, k + 1)
        turn1, turn2 = turns(one, 0, self.x)[0], turns(one, 1, self.x)[0]
        f = np.eye(21)
        f[:3, :3] = turn2.T
        f[:3, 15:18] = turn2.T @ self.r.T @ one.turned[0, 0]
        f[:3, 18:21] = -turn2.T @ one.turned[1, 0]
        self.r = turn1.T @ self.r @ turn2
        noise = np.r_[np.full(3, self.drift**2), WALKS**2] * KEY_S
        self.covariance = f @ self.covariance @ f.T + np.diag(noise)
        self.offset = f @ self.offset
        self._correction = turn2.T @ self._correction
        self._shown = turn2.T @ self._shown @ turn2

    def update(self, keys: Keys, k: int) -> None:
        """By rest and the link at key k."""
        for sensor in (0, 1):
            if at_rest(keys, sensor, k):
                self._rest(15 + 3 * sensor, keys.rate[sensor, k])
        share = float(keys.share[k])
        if share == 0.0:
            return
        one = keys.part(k, k + 1)
        (f1, j1), (f2, j2) = ((f[0], j[0]) for f, j in (seen_by(one, i, self.x) for i in (0, 1)))
        h = np.zeros((3, 21))
        h[:, :3] = self.r @ cross_matrix(f2)
        h[:, place_of(0)], h[:, place_of(1)] = j1, -(self.r @ j2)
        e = f1 - self.r @ f2 + h @ self.offset
        known = h @ self.covariance @ h.T
        noise = self.link_variance / share
        dilution = max(float(e @ np.linalg.solve(known + noise * ONE, e)) / LIMIT, 1.0)
        noise *= dilution * self.alike
        gain = np.linalg.solve(known + noise * ONE, h @ self.covariance).T
        correction = -gain @ e
        left = np.eye(21) - gain @ h
        self.covariance = left @ self.covariance @ left.T + noise * gain @ gain.T
        self.offset = self.offset + correction
        self._adapt(e * math.sqrt(share), dilution, float(np.trace(known)) * share / 3.0, correction[:3], cross_matrix(f2))
        if not self.frozen:
            self.settle()

    def _rest(self, at: int, rate: Array) -> None:
        """What a gyroscope reads at rest is its bias."""
        bias = slice(at, at + 3)
        seen = self.covariance[bias, bias] + REST_STD**2 * ONE
        gain = np.linalg.solve(seen, self.covariance[bias]).T
        correction = gain @ (rate - self.x[at - 3 : at] - self.offset[bias])
        self.covariance = self.covariance - gain @ seen @ gain.T
        self.offset = self.offset + correction
        if not self.frozen:
            self.settle()

    def settle(self) -> None:
        """Moves R and x by what was learned."""
        self.r, self.x, self.offset = self.r @ exp(self.offset[:3]), self.x + self.offset[3:], np.zeros(21)

    def _adapt(self, e: Array, dilution: float, explained: float, correction: Array, cross: Array) -> None:
        """Link noise, how alike neighbouring residuals are, and drift (after Mehra 1970), from the innovations."""
        third, share, variance = float(e @ e) / 3.0, KEY_S / LINK_S, self.link_variance
        now = min(third - min(explained, 0.5 * third), 9.0 * variance)
        self.link_variance = max(variance + (now - variance) * share, LEAST_LINK**2)
        e = e / math.sqrt(dilution)
        product, power = self._correlation
        product += (float(e @ self._past) - product) * share
        self._correlation = [product, power + (float(e @ e) - power) * share]
        relation = min(max(self._correlation[0] / (self._correlation[1] + 1e-12), 0.0), 0.8)
        self.alike, self._past = (1.0 + relation) / (1.0 - relation), e
        own, before = self._sizes
        own += (float(correction @ correction) - own) * KEY_S / SIZE_S
        before += (float(self._correction @ self._correction) - before) * KEY_S / SIZE_S
        relation = float(correction @ self._correction) / (math.sqrt(own * before) + 1e-30)
        drift = self.drift * (1.0 + DRIFT_RATE * KEY_S * min(max(relation, -1.0), 1.0))
        self._sizes, self._correction, self.drift = [own, before], correction, min(max(drift, LEAST_DRIFT), MOST_DRIFT)
        self._count += 1
        share = max(1.0 / self._count, 0.01)
        self._shown = self._shown + (cross.T @ cross - self._shown) * share
        self._scatter += (min(third, 9.0 * variance) - self._scatter) * share

    def stated(self) -> Array:
        """(3, 3) covariance of the orientation, rad²."""
        least = np.linalg.inv(self._shown + 1e-6 * ONE) * (self._scatter / self.settings.independent_links)
        return np.asarray(self.covariance[:3, :3] + least)

    def std(self) -> float:
        """Root of its trace, rad."""
        return math.sqrt(float(np.trace(self.stated())))


def start(keys: Keys, settings: Settings) -> tuple[KeyFilter, Array]:
    """The filter at the last of some keys, from these alone, and R at each."""
    x = np.zeros(18)
    _, _, (f1, f2) = residuals(keys, ONE, x)
    first, up = wahba(f1, f2), f2.mean(axis=0)
    headings = (first @ exp(up * (turn / np.linalg.norm(up))) for turn in (0.0, np.pi))
    _, w, x, link = min((descend(keys, w, x) for w in headings), key=lambda found: found[0])
    drift, alike = 0.002, 1.0
    for _ in range(3):
        back = [w]
        turn1, turn2 = turns(keys, 0, x), turns(keys, 1, x)
        for k in range(len(keys) - 1, 0, -1):
            back.append(turn1[k] @ back[-1] @ turn2[k].T)
        covariance = np.diag(np.r_[np.full(3, OPEN_VARIANCE), CONSTANTS_STD**2])
        kalman = KeyFilter(back[-1], x, covariance, settings, link, drift)
        kalman.offset[3:], kalman.frozen, kalman.alike = -x, True, alike
        for k in range(len(keys)):
            if k:
                kalman.predict(keys, k)
            kalman.update(keys, k)
        kalman.settle()
        kalman.frozen = False
        w, x, link, drift, alike = kalman.r, kalman.x, math.sqrt(kalman.link_variance), kalman.drift, kalman.alike
    return kalman, np.array(back[::-1])


@dataclass(frozen=True, eq=False)
class Tracked:
    """What a filter that began at some key says from its start on.

    Attributes:
        begin: the key at which it started; None: it never did.
        r: (K, 3, 3) from there on.
        covariance: (K, 3, 3) in the frame of sensor 2, rad².
        least_std: before the start, the least that an attempt stated, rad.
    """

    begin: int | None
    r: Array
    covariance: Array
    least_std: float


def track(keys: Keys, settings: Settings) -> Tracked:
    """Runs over all keys: a start as soon as two attempts in a row agree, and the filter from there on."""
    before: KeyFilter | None = None
    least_std, count, gap = math.inf, LEAST_KEYS, 0
    while count <= len(keys):
        kalman, trajectory = start(keys.part(max(0, count - MOST_KEYS), count), settings)
        std = kalman.std()
        least_std = min(least_std, std)
        if before is not None and std < settings.start_std and before.std() < 0.2:
            off = np.linalg.norm(log(before.r.T @ trajectory[-1 - gap]))
            if off < 3.0 * math.hypot(before.std(), std) + 0.01:
                return _go_on(keys, kalman, count, least_std)
        before, gap = kalman, EVERY_KEYS if count < 100 else 2 * EVERY_KEYS
        count += gap
    return Tracked(None, np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), least_std)


def _go_on(keys: Keys, kalman: KeyFilter, count: int, least_std: float) -> Tracked:
    found, covariances = [kalman.r], [kalman.stated()]
    for k in range(count, len(keys)):
        kalman.predict(keys, k)
        kalman.update(keys, k)
        found.append(kalman.r)
        covariances.append(kalman.stated())
    return Tracked(count - 1, np.array(found), np.array(covariances), least_std)
