//! Whole recordings, one or many: sample by sample where something happens, eight side by side where all is even.

use alloc::vec::Vec;

use super::{
    eight::EIGHT,
    filter::{Filter, alarm},
    lane::Real,
    method::Method,
    pack::{Room, together},
    run::{Done, Page, Signals, finish},
    settings::Settings,
};

/// A recording on its way.
pub(super) struct Passenger<'a, T, M> {
    number: usize,
    pub filter: Filter<T, M>,
    pub signals: Signals<'a>,
    /// Samples read so far.
    pub position: usize,
    pub page: Page<'a>,
}

impl<'a, T: Real, M: Method> Passenger<'a, T, M> {
    fn new(number: usize, settings: &Settings, method: M, signals: Signals<'a>, page: Page<'a>) -> Self {
        Self { number, filter: Filter::new(*settings, method), signals, position: 0, page }
    }

    /// Goes on alone, by one sample at least, until the next one may be one of many alike; says whether there is anything left.
    fn go_alone(&mut self, to_the_end: bool) -> bool {
        let count = self.signals.len();
        while self.position < count {
            let time = self.signals.time(self.position, self.filter.settings().rate_hz);
            let Self { filter, signals, page, position, .. } = self;
            filter.push_into(time, &signals.sample(*position), &mut |_, e| page.push(e));
            self.position += 1;
            if !to_the_end && self.may_join() {
                return true;
            }
        }
        finish(&mut self.filter, &self.signals, &mut self.page);
        false
    }

    /// Whether nothing is going on: even time, no start, all neighbours there. Few samples a second need no haste.
    fn may_join(&self) -> bool {
        let f = &self.filter;
        let reach = f.delay_samples();
        !f.turns_by_cubics()
            && f.start.is_none()
            && f.count == self.position as u64
            && f.done + reach == f.count
            && f.done >= f.stretch.max(f.even).max(f.unrepaired) + reach
            && f.lost == [0; 2]
            && !alarm(f.state.watch, f.state.q[0])
    }

    /// Whether both can sit side by side.
    fn suits(&self, other: &Self) -> bool {
        self.filter.step == other.filter.step && self.filter.settings.midpoint == other.filter.settings.midpoint
    }

    /// What became of it; its estimates begin at this row.
    fn done(&mut self, first: usize) -> Done {
        let starts = core::mem::take(&mut self.page.starts);
        Done { rows: first..first + self.page.filled, starts, restarts: self.filter.restarts() }
    }

    /// Samples not read yet.
    fn left(&self) -> usize {
        self.signals.len() - self.position
    }
}

/// So many samples a recording before the caller is asked again.
const ROUND: usize = 1 << 14;

/// Runs a filter over a recording. One estimate a sample, in the memory of `page`: where a start was needed, its solution is
/// carried back by the gyroscopes to the first sample that it explains. None if `keep_going`, asked every few ten thousand
/// samples, says no.
///
/// # Panics
///
/// If there is not room for all.
pub fn run<T: Real, M: Method>(
    settings: &Settings,
    method: M,
    signals: &Signals<'_>,
    page: Page<'_>,
    keep_going: &mut impl FnMut() -> bool,
) -> Option<(Done, Filter<T, M>)> {
    assert!(page.room() >= signals.len());
    let mut one = [Passenger::new(0, settings, method, *signals, page)];
    let mut room = Room::new();
    while keep_going() {
        if !one[0].go_alone(false) {
            let [mut passenger] = one;
            return Some((passenger.done(0), passenger.filter));
        }
        let steps = one[0].left().min(ROUND);
        together::<T, M, 1>(&mut one, steps, &mut room);
    }
    None
}

/// Runs the same filter over many recordings; those of one settings' stencil go side by side, where nothing is going on in any
/// of them. Each gets the bits that [`run`] gives it. The estimates of all are in one page, as many rows as it has samples for
/// each. None if `keep_going`, asked every few ten thousand samples, says no.
///
/// # Panics
///
/// If there is not room for all.
pub fn run_batch<T: Real, M: Method>(
    method: M,
    recordings: &[(Settings, Signals<'_>)],
    mut pages: Page<'_>,
    keep_going: &mut impl FnMut() -> bool,
) -> Option<Vec<Done>> {
    let mut done = Vec::with_capacity(recordings.len());
    let mut total = 0;
    for (_, signals) in recordings {
        done.push(Done { rows: total..total, ..Done::default() });
        total += signals.len();
    }
    assert!(pages.room() >= total);
    let mut waiting = recordings.iter().enumerate();
    let mut room = Room::new();
    let mut lanes: Vec<Passenger<'_, T, M>> = Vec::with_capacity(EIGHT);
    loop {
        while lanes.len() < EIGHT {
            let Some((number, (settings, signals))) = waiting.next() else { break };
            lanes.push(Passenger::new(number, settings, method, *signals, pages.take(signals.len())));
        }
        if lanes.is_empty() {
            return Some(done);
        }
        if !keep_going() {
            return None;
        }
        lanes.retain_mut(|lane| {
            let more = lane.go_alone(false);
            if !more {
                let done = &mut done[lane.number];
                *done = lane.done(done.rows.start);
            }
            more
        });
        let steps = lanes.iter().map(Passenger::left).min().unwrap_or(0).min(ROUND);
        // A few fill no lanes: their samples do.
        if lanes.len() >= FEW && lanes.iter().all(|lane| lane.suits(&lanes[0])) {
            together::<T, M, EIGHT>(&mut lanes, steps, &mut room);
        } else {
            for lane in &mut lanes {
                let steps = lane.left().min(ROUND);
                together::<T, M, 1>(core::slice::from_mut(lane), steps, &mut room);
            }
        }
    }
}

/// From so many recordings on they go side by side.
const FEW: usize = 3;
