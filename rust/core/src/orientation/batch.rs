//! Many recordings side by side: each fills one lane of the arithmetic, and gets the bits that [`run`](super::run()) gives it
//! alone.

use alloc::{vec, vec::Vec};

use super::{
    algebra::scale,
    filter::{Estimate, Filter, Settings, looks_wrong, spread},
    lane::{Lane, Real, Wide},
    method::{Method, Tuning, mean},
    ring::{LENGTH, five_points},
    run::{Signals, finish},
    state::{Moment, State, at_joint_center},
};

/// Streams side by side: two registers of four doubles hide each other's latencies.
pub const LANES: usize = 8;
/// Samples that are transposed together.
const CHUNK: usize = 32;

type Rows<T, const N: usize> = [Wide<T, N>; 12];

/// A recording on its way.
struct Passenger<'a, T, M> {
    number: usize,
    filter: Filter<T, M>,
    signals: Signals<'a>,
    /// Samples read so far.
    position: usize,
    estimates: Vec<Estimate>,
}

impl<T: Real, M: Method> Passenger<'_, T, M> {
    /// Goes on alone until it can join others; says whether there is anything left.
    fn go_alone(&mut self, to_the_end: bool) -> bool {
        let count = self.signals.len();
        while self.position < count {
            if !to_the_end && self.may_join() {
                return true;
            }
            let time = self.signals.time(self.position, self.filter.settings().rate_hz);
            let Self { filter, signals, estimates, position, .. } = self;
            filter.push_into(time, &signals.sample(*position), &mut |_, e| estimates.push(e));
            self.position += 1;
        }
        finish(&mut self.filter, &self.signals, &mut self.estimates);
        false
    }

    /// Whether the next sample is one of many alike: even time, no start, all neighbours there.
    fn may_join(&self) -> bool {
        let f = &self.filter;
        let reach = f.delay_samples();
        self.signals.time_s.is_none()
            && f.start.is_none()
            && f.count == self.position as u64
            && f.done + reach == f.count
            && f.done >= f.stretch.max(f.even).max(f.unrepaired) + reach
            && f.mended_before(f.done.saturating_sub(reach))
            && !self.repeats(self.position)
            && f.unbiased(&self.signals.sample(self.position)).iter().fold(T::default(), |sum, x| sum + *x).to_f64().is_finite()
    }

    /// Whether a sensor's row repeats the one before: a lost packet, which only a filter on its own mends.
    fn repeats(&self, position: usize) -> bool {
        let Some(before) = position.checked_sub(1) else { return false };
        let [gyr1, acc1, gyr2, acc2] = self.signals.xyz;
        let same = |x: &[crate::Xyz]| x.get(position) == x.get(before);
        (same(gyr1) && same(acc1)) || (same(gyr2) && same(acc2))
    }

    /// Whether both can sit side by side.
    fn suits(&self, other: &Self) -> bool {
        self.filter.step == other.filter.step && self.filter.settings.midpoint == other.filter.settings.midpoint
    }

    /// Samples not read yet.
    fn left(&self) -> usize {
        self.signals.len() - self.position
    }
}

/// Runs a filter over a recording. One estimate a sample: where a start was needed, its solution is carried back by the
/// gyroscopes to the first sample that it explains. None if `keep_going` says no.
pub fn run<T: Real, M: Method>(
    settings: &Settings,
    method: M,
    signals: &Signals<'_>,
    keep_going: &mut impl FnMut() -> bool,
) -> Option<(Vec<Estimate>, Filter<T, M>)> {
    let (filter, estimates) = (Filter::<T, M>::new(*settings, method), Vec::with_capacity(signals.len()));
    let mut lane = [Passenger { number: 0, filter, signals: *signals, position: 0, estimates }];
    loop {
        if !keep_going() {
            return None;
        }
        if !lane[0].go_alone(false) {
            let [Passenger { filter, estimates, .. }] = lane;
            return Some((estimates, filter));
        }
        together(method, &mut lane);
    }
}

/// Runs the same filter over many recordings. Even recordings of one settings' stencil go side by side; others go alone.
/// None if `keep_going`, asked every few ten thousand samples, says no.
pub fn run_batch<T: Real, M: Method>(
    method: M,
    recordings: &[(Settings, Signals<'_>)],
    keep_going: &mut impl FnMut() -> bool,
) -> Option<Vec<Vec<Estimate>>> {
    let mut results = vec![Vec::new(); recordings.len()];
    let mut waiting = recordings.iter().enumerate();
    let mut lanes: Vec<Passenger<'_, T, M>> = Vec::with_capacity(LANES);
    loop {
        while lanes.len() < LANES {
            let Some((number, (settings, signals))) = waiting.next() else { break };
            let (filter, estimates) = (Filter::new(*settings, method), Vec::with_capacity(signals.len()));
            lanes.push(Passenger { number, filter, signals: *signals, position: 0, estimates });
        }
        if lanes.is_empty() {
            return Some(results);
        }
        if !keep_going() {
            return None;
        }
        let few = lanes.iter().any(|l| !l.suits(&lanes[0]));
        lanes.retain_mut(|lane| {
            let more = lane.go_alone(few);
            if !more {
                results[lane.number] = core::mem::take(&mut lane.estimates);
            }
            more
        });
        if !lanes.is_empty() {
            together(method, &mut lanes);
        }
    }
}

/// So many samples a lane before the caller is asked again.
const ROUND: usize = 1 << 14;

/// Runs all lanes side by side until one of them must go on alone.
fn together<T: Real, M: Method>(method: M, lanes: &mut [Passenger<'_, T, M>]) {
    let steps = lanes.iter().map(Passenger::left).min().unwrap_or(0).min(ROUND);
    // A few lanes fit one register.
    match lanes.len() {
        1 => dispatch::<T, M, 1>(method, lanes, steps),
        2..=4 => dispatch::<T, M, 4>(method, lanes, steps),
        _ => dispatch::<T, M, LANES>(method, lanes, steps),
    }
}

fn dispatch<T: Real, M: Method, const N: usize>(method: M, lanes: &mut [Passenger<'_, T, M>], steps: usize) {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has the feature that the function was compiled for, as just asked.
        return unsafe { together_avx2::<T, M, N>(method, lanes, steps) };
    }
    together_wide::<T, M, N>(method, lanes, steps);
}

/// The same source with wider registers; no fused operations, so the same bits.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx2")]
fn together_avx2<T: Real, M: Method, const N: usize>(method: M, lanes: &mut [Passenger<'_, T, M>], steps: usize) {
    together_wide::<T, M, N>(method, lanes, steps);
}

#[inline(always)]
fn together_wide<T: Real, M: Method, const N: usize>(method: M, lanes: &mut [Passenger<'_, T, M>], steps: usize) {
    // Unused lanes repeat the first.
    let last = lanes.len() - 1;
    let of = |k: usize| k.min(last);
    let wide =
        |value: &dyn Fn(&Passenger<'_, T, M>) -> f64| Wide::<T, N>(core::array::from_fn(|k| T::splat(value(&lanes[of(k)]))));
    let vector = |value: &dyn Fn(&Passenger<'_, T, M>) -> [f64; 3]| {
        let all: [[f64; 3]; N] = core::array::from_fn(|k| value(&lanes[of(k)]));
        [0, 1, 2].map(|c| Wide::<T, N>(core::array::from_fn(|k| T::splat(all[k][c]))))
    };
    let dt = wide(&|l| l.filter.step_s);
    let per_dt = wide(&|l| l.filter.settings.rate_hz);
    let per = wide(&|l| l.filter.per);
    let r1 = vector(&|l| l.filter.settings.joint.r1);
    let r2 = vector(&|l| l.filter.settings.joint.r2);
    let tuning = Tuning {
        rate_var: wide(&|l| l.filter.tuning.rate_var),
        scale_noise: wide(&|l| l.filter.tuning.scale_noise),
        link_var: wide(&|l| l.filter.tuning.link_var),
    };
    let midpoint = lanes[0].filter.settings.midpoint;
    let h = lanes[0].filter.step as usize;
    let reach = 2 * h;

    let mut state = State::<Wide<T, N>>::new([0.0; 4], [0.0; 6], [0.0; 3], 0.0);
    for k in 0..N {
        let mut one = lanes[of(k)].filter.state;
        state.zip_with(&mut one, |wide, one| wide.0[k] = *one);
    }
    // Rows before the first new sample: what its stencil looks back on.
    let before = 2 * reach;
    let zero = Wide::<T, N>::splat(0.0);
    let mut rows: Vec<Rows<T, N>> = vec![[zero; 12]; before + CHUNK];
    // Gives the number of rows before the first one that is not finite in some lane.
    let fill = |rows: &mut [Rows<T, N>], lanes: &[Passenger<'_, T, M>], from: isize| {
        for k in 0..N {
            let lane = &lanes[of(k)];
            let bias = lane.filter.bias();
            for (j, row) in rows.iter_mut().enumerate() {
                let sample = lane.signals.sample((lane.position as isize + from + j as isize) as usize);
                for ((wide, x), b) in row.iter_mut().zip(sample).zip(bias) {
                    wide.0[k] = T::splat(x - b);
                }
            }
        }
        let finite = |row: &Rows<T, N>| row.iter().fold(zero, |sum, x| sum + *x).0.iter().all(|x| x.to_f64().is_finite());
        let fresh = |j: usize| from < 0 || lanes.iter().all(|lane| !lane.repeats(lane.position + from as usize + j));
        (0..rows.len()).position(|j| !(finite(&rows[j]) && fresh(j))).unwrap_or(rows.len())
    };
    fill(&mut rows[..before], lanes, -(before as isize));
    let mut done = 0;
    let mut stop = false;
    while done < steps && !stop {
        let wanted = CHUNK.min(steps - done);
        let length = fill(&mut rows[before..before + wanted], lanes, done as isize);
        stop = length < wanted;
        let mut worked = 0;
        for c in 0..length {
            // Row `reach + c` is worked in when row `before + c` has come.
            let middle = reach + c;
            let gyr = |row: usize, sensor: usize| {
                let r = &rows[row];
                [r[6 * sensor], r[6 * sensor + 1], r[6 * sensor + 2]]
            };
            let turn = |sensor: usize| {
                let now = gyr(middle, sensor);
                scale(if midpoint { mean(gyr(middle - 1, sensor), now) } else { now }, dt)
            };
            let acc = |sensor: usize, r: [Wide<T, N>; 3]| {
                let at = |row: usize| gyr(row, sensor);
                let dot = five_points(at(middle - reach), at(middle - h), at(middle + h), at(middle + reach), per);
                let row = &rows[middle];
                let acc = [row[6 * sensor + 3], row[6 * sensor + 4], row[6 * sensor + 5]];
                at_joint_center(acc, at(middle), dot, r)
            };
            let moment = Moment { dt, per_dt, turn1: turn(0), turn2: turn(1), acc1: acc(0, r1), acc2: acc(1, r2) };
            method.step(&tuning, &mut state, &moment, true);
            let std = spread(&method, &state);
            let mut alarm = false;
            for (k, lane) in lanes.iter_mut().enumerate() {
                let q = state.q.map(|x| x.0[k].to_f64());
                lane.estimates.push(Filter::<T, M>::judged(q, std.0[k].to_f64()));
                let [error, power] = state.watch.map(|x| x.0[k].to_f64());
                alarm |= looks_wrong(error, power) || !(error + q[0]).is_finite();
            }
            worked = c + 1;
            if alarm {
                stop = true;
                break;
            }
        }
        done += worked;
        rows.copy_within(worked..worked + before, 0);
    }
    for (k, lane) in lanes.iter_mut().enumerate() {
        lane.filter.adopt(&mut state, k, done, &lane.signals, lane.position);
        lane.position += done;
        // The last estimate was made before a restart that it gives the reason for.
        lane.filter.watch();
    }
}

impl<T: Real, M: Method> Filter<T, M> {
    /// Goes on from lane `k` of `wide`, `steps` samples after `position`.
    fn adopt<const N: usize>(
        &mut self,
        wide: &mut State<Wide<T, N>>,
        k: usize,
        steps: usize,
        signals: &Signals<'_>,
        position: usize,
    ) {
        wide.zip_with(&mut self.state, |wide, one| *one = wide.0[k]);
        self.count += steps as u64;
        self.done += steps as u64;
        for _ in 0..steps {
            self.tracking_s += self.step_s;
        }
        for back in (0..(LENGTH as usize).min(steps)).rev() {
            let at = position + steps - 1 - back;
            let sample = self.unbiased(&signals.sample(at));
            self.ring.put(at as u64, signals.time(at, self.settings.rate_hz), &sample);
        }
    }
}
