//! A bounded memory of an endless stream that covers all of it evenly.

use alloc::vec::Vec;
use serde::{Deserialize, Serialize};

/// Keeps every n-th of what it is given; whenever it is full, n doubles and every second entry is given up. What it holds
/// depends on what came, not on how it was cut into pieces.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Reservoir<T> {
    entries: Vec<T>,
    capacity: usize,
    stride: u64,
    seen: u64,
}

impl<T: Copy> Reservoir<T> {
    /// Holds between half of `capacity` and `capacity` entries once it has been full.
    pub fn new(capacity: usize) -> Self {
        Self { entries: Vec::new(), capacity: capacity.max(2), stride: 1, seen: 0 }
    }

    /// Offers one entry.
    pub fn push(&mut self, entry: T) {
        if self.seen.is_multiple_of(self.stride) {
            if self.entries.len() == self.capacity {
                let mut position = 0;
                self.entries.retain(|_| {
                    position += 1;
                    position % 2 == 1
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.entries.push(entry);
            }
        }
        self.seen += 1;
    }

    /// What it holds, in the order it came.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        self.capacity == fresh.capacity && self.entries.len() <= self.capacity && self.stride >= 1
    }

    /// How many were offered in all.
    pub fn seen(&self) -> u64 {
        self.seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_bounded_and_even() {
        let mut reservoir = Reservoir::new(8);
        for k in 0..1000_u64 {
            reservoir.push(k);
            let held = reservoir.entries();
            assert!(held.len() <= 8 && held[0] == 0);
            let step = held.get(1).copied().unwrap_or(1);
            assert!(held.iter().enumerate().all(|(n, &value)| value == n as u64 * step));
            assert!(k - held[held.len() - 1] < step);
        }
        assert_eq!(reservoir.seen(), 1000);
    }
}
