//! The complementary filter over many samples of one recording, in an order that keeps the processor busy.
//!
//! One sample's correction waits for the last one's, some hundred cycles long; all else of it need not wait there. So each group of
//! eight samples goes through three stages: the means that need no orientation, the corrections, and what they teach. In the
//! same stretch of code the second waits for its roots, the first is a group ahead and the third a group behind; and between
//! them, all that no sample waits for is done for a group at once. The operations are those of [`Complementary::step`].

use super::{
    algebra::Quat,
    complementary::Complementary,
    eight::{EIGHT, Eight},
    filter::alarm,
    lane::Real,
    method::{Method, Tuning},
    stages::{Ahead, Lesson, Seen, Trail},
    state::{Moment, State},
};

/// `N` numbers of eight samples.
type Group<T, const N: usize> = [[T; EIGHT]; N];

#[inline(always)]
fn store<T: Real, V: Eight<T>, const N: usize>(from: [V; N], to: &mut Group<T, N>) {
    for (to, from) in to.iter_mut().zip(from) {
        from.store(to);
    }
}

#[inline(always)]
fn load<T: Real, V: Eight<T>, const N: usize>(from: &Group<T, N>) -> [V; N] {
    let mut all = [V::splat(0.0); N];
    for (to, from) in all.iter_mut().zip(from) {
        *to = V::load(from);
    }
    all
}

/// Those of one of them.
#[inline(always)]
fn one<T: Real, const N: usize>(from: &Group<T, N>, k: usize) -> [T; N] {
    let mut all = [T::default(); N];
    for (to, from) in all.iter_mut().zip(from) {
        *to = from[k];
    }
    all
}

#[inline(always)]
fn put<T: Real, const N: usize>(from: [T; N], to: &mut Group<T, N>, k: usize) {
    for (to, from) in to.iter_mut().zip(from) {
        to[k] = from;
    }
}

/// Two groups of everything that goes from stage to stage.
#[derive(Default)]
struct Buffers<T> {
    drift: [Group<T, 2>; 2],
    trail: [Group<T, 5>; 2],
    ahead: [Group<T, 18>; 2],
    seen: [Group<T, 4>; 2],
    lesson: Group<T, 13>,
}

/// See [`Method::follow`]; goes on after alarms, and says whether there was one.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn follow<T: Real, V: Eight<T>>(
    method: &Complementary,
    tuning: &Tuning<f64>,
    state: &mut State<T>,
    moments: &[Moment<[T; EIGHT]>],
    pace: [f64; 2],
    all_q: &mut [Quat<T>],
    variances: &mut [T],
) -> bool {
    let (t, wide_t) = (tuning.cast::<T>(), tuning.cast::<V>());
    let (pace, wide_pace) = ([T::splat(pace[0]), T::splat(pace[1])], [V::splat(pace[0]), V::splat(pace[1])]);
    let moment = |row: usize| moments[row / EIGHT].each(|x| x[row % EIGHT]).at_pace(pace);
    let count = all_q.len();
    let groups = count.div_ceil(EIGHT);
    let mut b = Buffers::<T>::default();
    let mut q = state.q;
    let mut alarmed = false;
    for stage in 0..groups + 2 {
        let (odd, even) = (stage % 2, (stage + 1) % 2);
        // Three groups: of means, of corrections (`even`), of lessons (`odd` again).
        if stage >= 2 {
            let m = moments[stage - 2].each(|x| V::load(x)).at_pace(wide_pace);
            let lesson = method.lesson(&m, &Ahead::from_numbers(load(&b.ahead[odd])), &Seen::from_numbers(load(&b.seen[odd])));
            store(lesson.numbers(), &mut b.lesson);
        }
        if (1..=groups).contains(&stage) {
            let m = moments[stage - 1].each(|x| V::load(x)).at_pace(wide_pace);
            let ahead = method.ahead(&wide_t, &m, load(&b.drift[even]), &Trail::from_numbers(load(&b.trail[even])));
            store(ahead.numbers(), &mut b.ahead[even]);
        }
        if stage < groups {
            let m = moments[stage].each(|x| V::load(x)).at_pace(wide_pace);
            store(method.drift(&wide_t, &m), &mut b.drift[odd]);
        }
        for k in 0..EIGHT {
            let row = EIGHT * stage + k;
            if (EIGHT..count + EIGHT).contains(&row) {
                let row = row - EIGHT;
                let seen;
                (q, seen) = method.corrected(q, &moment(row), &Ahead::from_numbers(one(&b.ahead[even], k)));
                all_q[row] = q;
                put(seen.numbers(), &mut b.seen[even], k);
            }
            if (2 * EIGHT..count + 2 * EIGHT).contains(&row) {
                let row = row - 2 * EIGHT;
                let m = moment(row);
                method.absorb(state, &m, &Lesson::from_numbers(one(&b.lesson, k)));
                if state.leaning.wait(&m) {
                    let (ahead, seen) = (one(&b.ahead[odd], k), one(&b.seen[odd], k));
                    method.lean(&t, state, &m, &Ahead::from_numbers(ahead), &Seen::from_numbers(seen));
                }
                variances[row] = method.variance(state);
                alarmed |= alarm(state.watch, all_q[row][0]);
            }
            if row < count {
                put(method.trail(state, &moment(row), b.drift[odd][1][k]).numbers(), &mut b.trail[odd], k);
            }
        }
    }
    state.q = q;
    alarmed
}
