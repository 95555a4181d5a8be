//! Samples on their way in: bias-free, channel by channel, checked.

use super::{
    algebra::Vec3,
    batch::Passenger,
    eight::{EIGHT, Eight},
    filter::Filter,
    lane::Real,
    method::Method,
    ring::{WIDEST, is_even},
};

/// Numbers of a channel that are read at a time: samples times recordings.
pub(super) const READ: usize = 256;
/// Begins where a register's width in memory does: what crosses lines of the cache costs twice and more.
#[repr(align(64))]
pub(super) struct InLine<X>(pub X);

/// Numbers of a channel that there is room for: a group of eight may reach beyond the last row.
pub(super) const LONGEST: usize = 4 * WIDEST as usize * EIGHT + READ + EIGHT;

/// The recording in lane `k` of eight: the last one where there are fewer.
pub(super) fn sitting<'l, 'a, T, M>(lanes: &'l [Passenger<'a, T, M>], k: usize) -> &'l Passenger<'a, T, M> {
    &lanes[k.min(lanes.len() - 1)]
}

/// Bias-free samples, channel by channel: number `row * S + k` is that of recording `k`.
pub(super) struct Rows<'r, T, const S: usize> {
    channels: &'r mut [InLine<[T; LONGEST]>; 12],
    /// So many rows before the first new one: what derivatives look back on, and what brings new ones in line.
    pub before: usize,
    /// So far derivatives look ahead.
    pub ahead: usize,
    /// Of each signal and recording, as often as there are samples in a group.
    biases: InLine<[[[f64; 3 * EIGHT]; EIGHT]; 4]>,
}

impl<'r, T: Real, const S: usize> Rows<'r, T, S> {
    pub fn new<M: Method>(channels: &'r mut [InLine<[T; LONGEST]>; 12], lanes: &[Passenger<'_, T, M>]) -> Self {
        let ahead = lanes[0].filter.delay_samples() as usize;
        let before = if const { S == 1 } { (2 * ahead).next_multiple_of(EIGHT) } else { 2 * ahead };
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
            if const { S == 1 } {
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
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn read<M: Method, V: Eight<T>>(&mut self, lanes: &[Passenger<'_, T, M>], done: usize, count: usize) -> usize {
        self.put::<M, V>(lanes, done, count);
        let even = lanes.iter().map(|lane| lane.even_for(done, count)).min().unwrap_or(0);
        // All must be finite, and no sensor may repeat its row: lost packets are mended alone.
        for at in (0..even * S).step_by(EIGHT) {
            let (now, before) = (self.before * S + at, (self.before - 1) * S + at);
            if self.move_plainly::<V>(now, before) {
                continue;
            }
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

    /// Whether all is finite and both sensors' first channels change, which mostly says it all, and takes a third of the work.
    #[inline(always)]
    fn move_plainly<V: Eight<T>>(&self, now: usize, before: usize) -> bool {
        let mut sum = eight_at::<T, V>(&self.channels[0].0, now);
        let mut moved = sum - eight_at(&self.channels[0].0, before);
        for (k, channel) in self.channels.iter().enumerate().skip(1) {
            let x = eight_at::<T, V>(&channel.0, now);
            sum = sum + x;
            if k == 6 {
                moved = moved * (x - eight_at(&channel.0, before));
            }
        }
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        // No number is above or below itself, and infinity times zero is none.
        let sound = moved.at_least(-moved).where_above(sum * zero, one, zero);
        !one.any_above(sound)
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
    pub fn xyz<V: Eight<T>>(&self, channel: usize, at: usize) -> Vec3<V> {
        let [x, y, z] = [&self.channels[channel].0, &self.channels[channel + 1].0, &self.channels[channel + 2].0];
        [eight_at(x, at), eight_at(y, at), eight_at(z, at)]
    }

    /// Makes room behind the last rows.
    pub fn shift(&mut self, count: usize) {
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
}
