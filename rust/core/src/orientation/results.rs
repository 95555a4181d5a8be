//! Orientations and variances on their way out.

use super::{
    algebra::{Quat, dot4},
    batch::Passenger,
    eight::{EIGHT, Eight},
    filter::spread,
    lane::{Lane, Real},
    method::Method,
    pack::GROUPS,
    rows::InLine,
    run::UNSOUND,
};

/// 1 where an orientation is one and goes on from the one before without a change of sign, else 0.
#[inline(always)]
pub(super) fn goes_on<L: Lane>(before: Quat<L>, q: Quat<L>) -> L {
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

/// Of one recording, or of eight one after the other; while rows come in, those of
/// eight lie side by side.
pub(super) struct Results<T> {
    pub q: InLine<[[T; 4]; GROUPS * EIGHT]>,
    pub variance: InLine<[T; GROUPS * EIGHT]>,
}

impl<T: Real> Results<T> {
    #[inline(always)]
    pub fn put_eight<V: Eight<T>>(&mut self, row: usize, q: &[V; 4], variance: V) {
        for (all, q) in self.q.0.as_flattened_mut().as_chunks_mut().0[4 * row..].iter_mut().zip(q) {
            q.store(all);
        }
        variance.store(&mut self.variance.0.as_chunks_mut().0[row]);
    }

    /// Gives each recording its estimates of the first rows.
    #[inline(always)]
    pub fn hand_over<M: Method, V: Eight<T>, const S: usize>(
        &mut self,
        lanes: &mut [Passenger<'_, T, M>],
        rows: usize,
        smooth: bool,
    ) {
        for group in self.variance.0.as_chunks_mut().0.iter_mut().take((rows * S).div_ceil(EIGHT)) {
            spread(V::load(group)).store(group);
        }
        if const { S > 1 } {
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
