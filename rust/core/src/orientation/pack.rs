//! Many samples at a time, where nothing is going on.
//!
//! All that does not depend on what a filter knows, more than half of the work, is done for eight instants side by side: turns,
//! their exponentials, derivatives, accelerations of the joint centre. Lanes are eight neighbouring samples of one recording, or
//! the same sample of eight. What is left waits for the sample before: in one recording number by number, in eight lane by lane.
//!
//! # Floor
//!
//! A sample moves 96 bytes in and 41 out. In one recording the chain from one orientation to the next sets the floor, in cycles
//! of latency (addition 2, multiplication 3, division 13, root 20, as on Zen 5): for the complementary filter two quaternion
//! products 14, `Rᵀa1` 12, gradient with heading gain 22, its length 5, root beside division 26, step 10: about 90, 24 ns at
//! 3.85 GHz, and a sixth of that for what is done side by side. The Kalman filter's, through both 2×2 inverses, has about 150.
//! Both take about twice as long, since the core looks ahead no farther than one sample's instructions. Eight
//! recordings are bound by instructions, not latency; `benches/orientation.py` measures.

use alloc::boxed::Box;

use super::{
    algebra::{Quat, Vec3, dot4, scale},
    batch::Passenger,
    eight::{Array, EIGHT, Eight},
    filter::{Filter, alarm, spread},
    lane::{Lane, Real},
    method::{Method, Tuning, mean},
    ring::{WIDEST, five_points, is_even},
    run::UNSOUND,
    state::{Moment, State, at_joint_center},
};

/// Numbers of a channel that are read at a time: samples times recordings.
const READ: usize = 256;
/// Groups of eight instants that are worked out at a time.
const GROUPS: usize = 2 * EIGHT;

/// Runs `S` recordings (fewer repeat the last one) side by side for `steps` samples, or until one must go on alone: at once on
/// x86-64 without AVX2, which is not worth code of its own.
pub(super) fn together<T: Real, M: Method, const S: usize>(
    lanes: &mut [Passenger<'_, T, M>],
    steps: usize,
    room: &mut Room<T>,
) {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    if T::HAS_WIDER && std::arch::is_x86_feature_detected!("avx512f") {
        // SAFETY: the processor has the feature that the function was compiled for, as just asked.
        unsafe { together_avx512::<T, M, S>(lanes, steps, room) }
    } else if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has the feature that the function was compiled for, as just asked.
        unsafe { together_avx2::<T, M, S>(lanes, steps, room) }
    }
    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    together_in::<T, M, T::Registers, S>(lanes, steps, room);
}

/// The same source with wider registers; no fused operations, so the same bits.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx2")]
fn together_avx2<T: Real, M: Method, const S: usize>(lanes: &mut [Passenger<'_, T, M>], steps: usize, room: &mut Room<T>) {
    together_in::<T, M, T::Registers, S>(lanes, steps, room);
}

/// The same in the widest.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx512f")]
fn together_avx512<T: Real, M: Method, const S: usize>(lanes: &mut [Passenger<'_, T, M>], steps: usize, room: &mut Room<T>) {
    together_in::<T, M, T::Wider, S>(lanes, steps, room);
}

#[inline(always)]
fn together_in<T: Real, M: Method, V: Eight<T>, const S: usize>(
    lanes: &mut [Passenger<'_, T, M>],
    steps: usize,
    room: &mut Room<T>,
) {
    let method = lanes[0].filter.method;
    let constants = Constants::<V>::of::<T, M>(lanes);
    let tuning = lanes[0].filter.tuning;
    let pace = [lanes[0].filter.step_s, lanes[0].filter.settings.rate_hz];
    // One of these is used.
    let mut one = lanes[0].filter.state;
    let mut eight = State::<V>::new([0.0; 4], [0.0; 6], [0.0; 3], 0.0);
    if S > 1 {
        gather(lanes, &mut eight);
    }
    let Room { channels, moments: InLine(moments), results } = room;
    let mut rows = Rows::<T, S>::new(channels, lanes);
    let mut done = 0;
    let mut stop = false;
    // 1 in all lanes: nothing has to be done about their orientations in the end. One recording is looked at afterwards.
    let mut smooth = V::splat(0.0);
    while done < steps && !stop {
        let wanted = (READ / S).min(steps - done);
        let length = rows.read::<M, V>(lanes, done, wanted);
        stop = length < wanted;
        for first in (0..length).step_by(GROUPS * EIGHT / S) {
            let count = (length - first).min(GROUPS * EIGHT / S);
            // Two times the same, number by number and lane by lane.
            let alarmed = if S == 1 {
                constants.look_at_all(&rows, first, &mut moments[..count.div_ceil(EIGHT)]);
                let Results { q: InLine(q), variance: InLine(variance) } = results;
                method.follow::<T, V>(&tuning, &mut one, moments, pace, &mut q[..count], &mut variance[..count])
            } else {
                let mut alarmed = None;
                smooth = V::splat(1.0);
                for row in 0..count {
                    let (moment, before) = (constants.look(&rows, first, row), eight.q);
                    method.step(&constants.tuning, &mut eight, &moment, true);
                    smooth = smooth.at_most(goes_on(before, eight.q));
                    results.put_eight(row, &eight.q, method.variance(&eight));
                    if alarm(eight.watch, eight.q[0]) {
                        alarmed = Some(row);
                        break;
                    }
                }
                alarmed
            };
            let worked_in = alarmed.map_or(count, |row| row + 1);
            results.hand_over::<M, V, S>(lanes, worked_in, !V::splat(1.0).any_above(smooth));
            done += worked_in;
            if alarmed.is_some() {
                stop = true;
                break;
            }
        }
        if !stop {
            rows.shift(length);
        }
    }
    if S == 1 {
        lanes[0].filter.state = one;
    } else {
        scatter(lanes, &mut eight);
    }
    for lane in lanes {
        lane.adopt(done);
    }
}

/// Begins where a register's width in memory does: what crosses lines of the cache costs twice and more.
#[repr(align(64))]
struct InLine<X>(X);

/// Numbers of a channel that there is room for: a group of eight may reach beyond the last row.
const LONGEST: usize = 4 * WIDEST as usize * EIGHT + READ + EIGHT;

/// Memory to work in, for any number of calls.
pub(super) struct Room<T> {
    channels: Box<[InLine<[T; LONGEST]>; 12]>,
    moments: InLine<[Moment<[T; EIGHT]>; GROUPS]>,
    results: Results<T>,
}

impl<T: Real> Room<T> {
    pub fn new() -> Self {
        let results =
            Results { q: InLine([[T::default(); 4]; GROUPS * EIGHT]), variance: InLine([T::default(); GROUPS * EIGHT]) };
        let channels = Box::new([(); 12].map(|()| InLine([T::default(); LONGEST])));
        Self { channels, moments: InLine(Default::default()), results }
    }
}

/// What stays the same from sample to sample, lane by lane.
struct Constants<V> {
    dt: V,
    per_dt: V,
    /// What differences are multiplied with to be derivatives, 1/s.
    per: V,
    r: [Vec3<V>; 2],
    tuning: Tuning<V>,
    midpoint: bool,
    /// Step of the stencil, samples.
    step: usize,
}

/// The recording in lane `k` of eight: the last one where there are fewer.
fn sitting<'l, 'a, T, M>(lanes: &'l [Passenger<'a, T, M>], k: usize) -> &'l Passenger<'a, T, M> {
    &lanes[k.min(lanes.len() - 1)]
}

impl<V> Constants<V> {
    fn of<T: Real, M: Method>(lanes: &[Passenger<'_, T, M>]) -> Self
    where
        V: Eight<T>,
    {
        let wide = |value: &dyn Fn(&Filter<T, M>) -> f64| {
            V::load(&core::array::from_fn(|k| T::splat(value(&sitting(lanes, k).filter))))
        };
        let Filter { settings, step, .. } = &lanes[0].filter;
        Self {
            dt: wide(&|f| f.step_s),
            per_dt: wide(&|f| f.settings.rate_hz),
            per: wide(&|f| f.per),
            r: [
                [wide(&|f| f.settings.joint.r1[0]), wide(&|f| f.settings.joint.r1[1]), wide(&|f| f.settings.joint.r1[2])],
                [wide(&|f| f.settings.joint.r2[0]), wide(&|f| f.settings.joint.r2[1]), wide(&|f| f.settings.joint.r2[2])],
            ],
            tuning: Tuning {
                rate_var: wide(&|f| f.tuning.rate_var),
                scale_noise: wide(&|f| f.tuning.scale_noise),
                link_var: wide(&|f| f.tuning.link_var),
                bias_var: wide(&|f| f.tuning.bias_var),
            },
            midpoint: settings.midpoint,
            step: *step as usize,
        }
    }

    /// Works out groups of eight instants from row `first` on.
    #[inline(always)]
    fn look_at_all<T: Real, const S: usize>(&self, rows: &Rows<'_, T, S>, first: usize, moments: &mut [Moment<[T; EIGHT]>])
    where
        V: Eight<T>,
    {
        for (j, moment) in moments.iter_mut().enumerate() {
            *moment = self.look(rows, first, j).each(|x| {
                let mut numbers = [T::default(); EIGHT];
                x.store(&mut numbers);
                numbers
            });
        }
    }

    /// Works out group `j` of eight instants from row `first` on.
    #[inline(always)]
    fn look<T: Real, const S: usize>(&self, rows: &Rows<'_, T, S>, first: usize, j: usize) -> Moment<V>
    where
        V: Eight<T>,
    {
        // The sample whose neighbours have come with the row.
        let at = (rows.before - rows.ahead + first) * S + j * EIGHT;
        let (turn1, acc1) = self.sensor(rows, at, 0);
        let (turn2, acc2) = self.sensor(rows, at, 1);
        Moment::new([self.dt, self.per_dt], [turn1, turn2], [acc1, acc2])
    }

    /// Turn, and acceleration of the joint centre.
    #[inline(always)]
    fn sensor<T: Real, const S: usize>(&self, rows: &Rows<'_, T, S>, at: usize, sensor: usize) -> (Vec3<V>, Vec3<V>)
    where
        V: Eight<T>,
    {
        let (gyr, step) = (6 * sensor, self.step * S);
        let now = rows.xyz(gyr, at);
        let rate = if self.midpoint { mean(rows.xyz(gyr, at - S), now) } else { now };
        let before = [rows.xyz(gyr, at - 2 * step), rows.xyz(gyr, at - step)];
        let after = [rows.xyz(gyr, at + step), rows.xyz(gyr, at + 2 * step)];
        let dot = five_points(before[0], before[1], after[0], after[1], self.per);
        (scale(rate, self.dt), at_joint_center(rows.xyz(gyr + 3, at), now, dot, self.r[sensor]))
    }
}

/// The states of eight recordings into lanes.
fn gather<T: Real, M: Method, V: Eight<T>>(lanes: &[Passenger<'_, T, M>], eight: &mut State<V>) {
    let mut numbers = State::<Array<T>>::new([0.0; 4], [0.0; 6], [0.0; 3], 0.0);
    for k in 0..EIGHT {
        let mut one = sitting(lanes, k).filter.state;
        numbers.zip_with(&mut one, |numbers, one| numbers.0[k] = *one);
    }
    eight.zip_with(&mut numbers, |eight, numbers| *eight = V::load(&numbers.0));
}

fn scatter<T: Real, M: Method, V: Eight<T>>(lanes: &mut [Passenger<'_, T, M>], eight: &mut State<V>) {
    let mut numbers = State::<Array<T>>::new([0.0; 4], [0.0; 6], [0.0; 3], 0.0);
    eight.zip_with(&mut numbers, |eight, numbers| eight.store(&mut numbers.0));
    for (k, lane) in lanes.iter_mut().enumerate() {
        numbers.zip_with(&mut lane.filter.state, |numbers, one| *one = numbers.0[k]);
    }
}

/// Bias-free samples, channel by channel: number `row * S + k` is that of recording `k`.
struct Rows<'r, T, const S: usize> {
    channels: &'r mut [InLine<[T; LONGEST]>; 12],
    /// So many rows before the first new one: what derivatives look back on, and what brings new ones in line.
    before: usize,
    /// So far derivatives look ahead.
    ahead: usize,
    /// Of each signal and recording, as often as there are samples in a group.
    biases: InLine<[[[f64; 3 * EIGHT]; EIGHT]; 4]>,
}

impl<'r, T: Real, const S: usize> Rows<'r, T, S> {
    fn new<M: Method>(channels: &'r mut [InLine<[T; LONGEST]>; 12], lanes: &[Passenger<'_, T, M>]) -> Self {
        let ahead = lanes[0].filter.delay_samples() as usize;
        let before = if S == 1 { (2 * ahead).next_multiple_of(EIGHT) } else { 2 * ahead };
        let mut biases = [[[0.0; 3 * EIGHT]; EIGHT]; 4];
        for k in 0..S {
            let bias = sitting(lanes, k).filter.bias();
            for (biases, bias) in biases.iter_mut().zip(bias.as_chunks::<3>().0) {
                biases[k].as_chunks_mut().0.fill(*bias);
            }
        }
        // The ring's rows, not the recording's: where packets were lost they are mended.
        for k in 0..S {
            let Filter { ring, count, .. } = &sitting(lanes, k).filter;
            for back in 1..=2 * ahead {
                let at = (before - back) * S + k;
                for (channel, x) in channels.iter_mut().zip(ring.row(count - back as u64)) {
                    channel.0[at] = *x;
                }
            }
        }
        Self { channels, before, ahead, biases: InLine(biases) }
    }

    /// Puts `count` new samples of each recording, from `done` samples after its position on, behind the rows before.
    #[inline(always)]
    fn put<M: Method, V: Eight<T>>(&mut self, lanes: &[Passenger<'_, T, M>], done: usize, count: usize) {
        let row = self.before;
        // Eight samples of one recording are taken apart in registers, those of eight change rows and columns there; what is left
        // over goes one by one.
        let whole = count - count % EIGHT;
        for (s, channels) in self.channels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            if S == 1 {
                let lane = &lanes[0];
                let at = lane.position + done;
                let samples = lane.signals.xyz[s][at..at + whole].as_chunks::<EIGHT>().0;
                let biases = self.biases.0[s][0].as_chunks().0;
                let [x, y, z] = channels.each_mut().map(|c| c.0[row..row + whole].as_chunks_mut::<EIGHT>().0);
                for (((x, y), z), samples) in x.iter_mut().zip(y).zip(z).zip(samples) {
                    let mut parts = [V::splat(0.0); 3];
                    for ((part, numbers), bias) in parts.iter_mut().zip(samples.as_flattened().as_chunks().0).zip(biases) {
                        *part = V::difference(numbers, bias);
                    }
                    let [all_x, all_y, all_z] = V::apart(parts);
                    all_x.store(x);
                    all_y.store(y);
                    all_z.store(z);
                }
            } else if whole > 0 {
                let mut samples = [[].as_slice(); EIGHT];
                for (k, samples) in samples.iter_mut().enumerate() {
                    let lane = sitting(lanes, k);
                    let at = lane.position + done;
                    *samples = lane.signals.xyz[s][at..at + whole].as_chunks::<EIGHT>().0;
                }
                let groups =
                    channels.each_mut().map(|c| c.0[S * row..S * (row + whole)].as_chunks_mut().0.as_chunks_mut::<EIGHT>().0);
                let [x, y, z] = groups;
                for (first, ((x, y), z)) in x.iter_mut().zip(y).zip(z).enumerate() {
                    for part in 0..3 {
                        let mut rows = [V::splat(0.0); EIGHT];
                        for (k, row) in rows.iter_mut().enumerate() {
                            let samples = samples[k][first].as_flattened().as_chunks().0;
                            *row = V::difference(&samples[part], &self.biases.0[s][k].as_chunks().0[part]);
                        }
                        for (j, numbers) in V::transposed(rows).into_iter().enumerate() {
                            let number = EIGHT * part + j;
                            numbers.store([&mut *x, &mut *y, &mut *z][number % 3].each_mut()[number / 3]);
                        }
                    }
                }
            }
            for k in 0..S {
                let lane = sitting(lanes, k);
                let (bias, at) = (&self.biases.0[s][k], lane.position + done);
                let rows = S * (row + whole)..S * (row + count);
                let [x, y, z] = channels.each_mut().map(|c| c.0[rows.clone()].as_chunks_mut::<S>().0);
                let samples = lane.signals.xyz[s][at + whole..at + count].iter();
                for (((x, y), z), xyz) in x.iter_mut().zip(y).zip(z).zip(samples) {
                    x[k] = T::splat(xyz[0] - bias[0]);
                    y[k] = T::splat(xyz[1] - bias[1]);
                    z[k] = T::splat(xyz[2] - bias[2]);
                }
            }
        }
    }

    /// Reads so many new samples of each recording, `done` samples after their positions; gives how many of them may be worked
    /// in.
    #[inline(always)]
    fn read<M: Method, V: Eight<T>>(&mut self, lanes: &[Passenger<'_, T, M>], done: usize, count: usize) -> usize {
        self.put::<M, V>(lanes, done, count);
        let even = lanes.iter().map(|lane| lane.even_for(done, count)).min().unwrap_or(0);
        // All must be finite, and no sensor may repeat its row: lost packets are mended alone.
        for at in (0..even * S).step_by(EIGHT) {
            let (now, before) = (self.before * S + at, (self.before - 1) * S + at);
            let moved = self.distance::<V>(0, now, before) * self.distance::<V>(6, now, before);
            let (zero, one) = (V::splat(0.0), V::splat(1.0));
            let sound = moved.where_above(zero, V::splat(f64::INFINITY).where_above(moved, one, zero), zero);
            if one.any_above(sound) {
                let mut numbers = [T::default(); EIGHT];
                sound.store(&mut numbers);
                let k = numbers.iter().position(|x| x.to_f64() == 0.0).unwrap_or(0);
                return even.min((at + k) / S);
            }
        }
        even
    }

    /// Sum of the changes of the six channels of a sensor.
    #[inline(always)]
    fn distance<V: Eight<T>>(&self, sensor: usize, now: usize, before: usize) -> V {
        let mut sum = V::splat(0.0);
        for channel in &self.channels[sensor..sensor + 6] {
            let change = eight_at::<T, V>(&channel.0, now) - eight_at(&channel.0, before);
            sum = sum + change.at_least(-change);
        }
        sum
    }

    #[inline(always)]
    fn xyz<V: Eight<T>>(&self, channel: usize, at: usize) -> Vec3<V> {
        let [x, y, z] = [&self.channels[channel].0, &self.channels[channel + 1].0, &self.channels[channel + 2].0];
        [eight_at(x, at), eight_at(y, at), eight_at(z, at)]
    }

    /// Makes room behind the last rows.
    fn shift(&mut self, count: usize) {
        for channel in self.channels.iter_mut() {
            channel.0.copy_within(count * S..(count + self.before) * S, 0);
        }
    }
}

#[inline(always)]
fn eight_at<T: Real, V: Eight<T>>(channel: &[T], at: usize) -> V {
    debug_assert!(at + EIGHT <= channel.len());
    // SAFETY: rows has room for the groups it is read in, see Rows::new.
    V::load(unsafe { &*channel.as_ptr().add(at).cast() })
}

/// 1 where an orientation is one and goes on from the one before without a change of sign, else 0.
#[inline(always)]
fn goes_on<L: Lane>(before: Quat<L>, q: Quat<L>) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let off = dot4(q, q) - one;
    let sound = L::splat(UNSOUND).where_above(off.at_least(-off), one, zero);
    dot4(before, q).where_above(zero, sound, zero)
}

/// Rows and columns of eight by eight numbers change places.
#[inline(always)]
fn transposed<T: Real, V: Eight<T>>(from: &[[T; EIGHT]; EIGHT]) -> [V; EIGHT] {
    let mut rows = [V::splat(0.0); EIGHT];
    for (row, from) in rows.iter_mut().zip(from) {
        *row = V::load(from);
    }
    V::transposed(rows)
}

/// Orientations and variances on their way out: of one recording, or of eight one after the other; while rows come in, those of
/// eight lie side by side.
struct Results<T> {
    q: InLine<[[T; 4]; GROUPS * EIGHT]>,
    variance: InLine<[T; GROUPS * EIGHT]>,
}

impl<T: Real> Results<T> {
    #[inline(always)]
    fn put_eight<V: Eight<T>>(&mut self, row: usize, q: &[V; 4], variance: V) {
        for (all, q) in self.q.0.as_flattened_mut().as_chunks_mut().0[4 * row..].iter_mut().zip(q) {
            q.store(all);
        }
        variance.store(&mut self.variance.0.as_chunks_mut().0[row]);
    }

    /// Gives each recording its estimates of the first rows.
    #[inline(always)]
    fn hand_over<M: Method, V: Eight<T>, const S: usize>(
        &mut self,
        lanes: &mut [Passenger<'_, T, M>],
        rows: usize,
        smooth: bool,
    ) {
        for group in self.variance.0.as_chunks_mut().0.iter_mut().take((rows * S).div_ceil(EIGHT)) {
            spread(V::load(group)).store(group);
        }
        if S > 1 {
            self.turn_over::<V>();
        }
        for (k, lane) in lanes.iter_mut().enumerate() {
            let at = k * GROUPS * EIGHT / S..k * GROUPS * EIGHT / S + rows;
            lane.page.extend(&self.q.0[at.clone()], &self.variance.0[at], smooth);
        }
    }

    /// Rows of eight recordings: recording by recording.
    #[inline(always)]
    fn turn_over<V: Eight<T>>(&mut self) {
        let (q, variance) = (InLine(self.q.0), InLine(self.variance.0));
        let (from, to) = (q.0.as_flattened().as_chunks().0, self.q.0.as_flattened_mut().as_chunks_mut().0);
        for (part, from) in from.as_chunks::<EIGHT>().0.iter().enumerate() {
            for (k, q) in transposed::<T, V>(from).into_iter().enumerate() {
                q.store(&mut to[GROUPS / 2 * k + part]);
            }
        }
        let (from, to) = (variance.0.as_chunks().0, self.variance.0.as_chunks_mut().0);
        for (part, from) in from.as_chunks::<EIGHT>().0.iter().enumerate() {
            for (k, variance) in transposed::<T, V>(from).into_iter().enumerate() {
                variance.store(&mut to[GROUPS / EIGHT * k + part]);
            }
        }
    }
}

impl<T: Real, M: Method> Passenger<'_, T, M> {
    /// How many of `count` samples follow each other evenly, from `done` after the position on.
    #[inline(always)]
    fn even_for(&self, done: usize, count: usize) -> usize {
        let first = self.position + done;
        let Some(times) = self.signals.time_s else { return count };
        let rate_hz = self.filter.settings.rate_hz;
        let even = |t: &[f64]| is_even((t[1] - t[0]) * rate_hz);
        let pairs = times[first - 1..first + count].windows(2);
        // All at once, and only where that fails one by one.
        if pairs.clone().fold(true, |all, t| all & even(t)) { count } else { pairs.take_while(|t| even(t)).count() }
    }

    /// Goes on `steps` samples later, when the state has already.
    fn adopt(&mut self, steps: usize) {
        let Self { filter, signals, position, .. } = self;
        filter.count += steps as u64;
        filter.done += steps as u64;
        filter.tracked_for(steps, filter.step_s);
        *position += steps;
        // Of the ring only what the next ones can look back on.
        let reach = 2 * filter.delay_samples() as usize + 2;
        for at in position.saturating_sub(reach.min(steps))..*position {
            let sample = filter.unbiased(&signals.sample(at));
            filter.ring.put(at as u64, signals.time(at, filter.settings.rate_hz), &sample);
        }
        // The last estimate was made before a restart that it gives the reason for.
        filter.watch();
    }
}
