//! Many samples at a time, where nothing is going on.
//!
//! All that does not depend on what a filter knows, more than half of the work, is done for eight instants side by side: turns,
//! their exponentials, derivatives, accelerations of the joint centre. Lanes are eight neighbouring samples of one recording, or
//! the same sample of eight. What is left waits for the sample before: in one recording number by number, in eight lane by lane.
//!
//! # Floor
//!
//! A sample moves 96 bytes in and 40 out. In one recording the chain from one orientation to the next sets the floor, in cycles
//! of latency (addition 2, multiplication 3, division 13, root 20, as on Zen 5): for the complementary filter two quaternion
//! products 14, `Rᵀa1` 12, squares of the gradient with heading gain 18, root beside division 29, step 5: about 80, 21 ns at
//! 3.75 GHz. `interleaved` takes about 32 ns with all that goes on beside the chain, which counts too, for numbers one by one fill
//! the multipliers; reading, looking, handing over and the start take another 16. The Kalman filter's chain, through both 2×2
//! inverses, has about 150 cycles, and it takes twice as long, since the core looks ahead no farther than one sample's
//! instructions. Eight recordings are bound by instructions, not latency; `benches/orientation.py` measures.

use alloc::boxed::Box;

use super::{
    algebra::{Vec3, scale},
    batch::Passenger,
    eight::{Array, EIGHT, Eight},
    filter::{Filter, alarm},
    lane::Real,
    method::{Method, Tuning},
    results::{Results, goes_on},
    ring::{LENGTH, five_points},
    rows::{InLine, LONGEST, READ, Rows, sitting},
    state::{Moment, State, at_joint_center},
    turns::mean,
};

/// Groups of eight instants that are worked out at a time.
pub(super) const GROUPS: usize = 2 * EIGHT;

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
    if const { S > 1 } {
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
            let alarmed = if const { S == 1 } {
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
    if const { S == 1 } {
        lanes[0].filter.state = one;
    } else {
        scatter(lanes, &mut eight);
    }
    for lane in lanes {
        lane.adopt(done);
    }
}

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
    #[cfg_attr(not(debug_assertions), inline(always))]
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

impl<T: Real, M: Method> Passenger<'_, T, M> {
    /// Goes on `steps` samples later, when the state has already.
    fn adopt(&mut self, steps: usize) {
        let Self { filter, signals, position, .. } = self;
        filter.count += steps as u64;
        filter.done += steps as u64;
        filter.tracked_for(steps, filter.step_s);
        *position += steps;
        for at in position.saturating_sub((LENGTH as usize).min(steps))..*position {
            let sample = filter.unbiased(&signals.sample(at));
            filter.ring.put(at as u64, signals.time(at, filter.settings.rate_hz), &sample);
        }
        // The last estimate was made before a restart that it gives the reason for.
        filter.watch();
    }
}
