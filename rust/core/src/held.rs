//! Rows that were lost on the way and stand as copies of the last one that arrived.

use alloc::vec::Vec;

use crate::Xyz;

/// One sensor's samples with lost rows filled in.
#[derive(Clone, Debug)]
pub struct Filled {
    /// Angular rate, rad/s.
    pub gyr: Vec<Xyz>,
    /// Specific force, m/s².
    pub acc: Vec<Xyz>,
    /// Whether a row was lost: a copy of the one before it in all six channels.
    pub held: Vec<bool>,
}

/// Copies over longer than this were not lost on the way: a coarse sensor at rest, s.
const LONGEST_S: f64 = 0.4;

/// Replaces copies of an earlier row by the straight line from that row to the next fresh one. The row that is copied did
/// arrive: on recordings with lost packets the likelihood tells that it stays and the copies go.
pub fn fill(time_s: &[f64], gyr: &[Xyz], acc: &[Xyz]) -> Filled {
    let mut filled = Filled { gyr: gyr.to_vec(), acc: acc.to_vec(), held: alloc::vec![false; gyr.len()] };
    let mut fresh = 0;
    for k in 1..gyr.len() {
        if gyr[k] == gyr[k - 1] && acc[k] == acc[k - 1] {
            continue;
        }
        let lost = if time_s[k] - time_s[fresh] > LONGEST_S { k..k } else { fresh + 1..k };
        for n in lost {
            filled.held[n] = true;
            let share = (time_s[n] - time_s[fresh]) / (time_s[k] - time_s[fresh]);
            let between = |a: &Xyz, b: &Xyz| core::array::from_fn(|c| a[c] + share * (b[c] - a[c]));
            filled.gyr[n] = between(&gyr[fresh], &gyr[k]);
            filled.acc[n] = between(&acc[fresh], &acc[k]);
        }
        fresh = k;
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_become_a_straight_line_and_fresh_rows_stay() {
        let time: Vec<f64> = (0..7).map(|k| f64::from(k) * 0.05).collect();
        let rows: Vec<Xyz> = [0.0, 1.0, 1.0, 1.0, 7.0, 7.0, 8.0].iter().map(|&v| [v, -v, 2.0 * v]).collect();
        let filled = fill(&time, &rows, &rows);
        let first: Vec<f64> = filled.gyr.iter().map(|g| g[0]).collect();
        let expected = [0.0, 1.0, 3.0, 5.0, 7.0, 7.5, 8.0];
        assert!(first.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{first:?}");
        assert_eq!(filled.held, [false, false, true, true, false, true, false]);
        assert_eq!(filled.acc, filled.gyr);
    }

    #[test]
    fn long_standstill_is_believed() {
        let time: Vec<f64> = (0..20).map(|k| f64::from(k) * 0.05).collect();
        let rows: Vec<Xyz> = (0..20).map(|k| if k < 15 { [1.0; 3] } else { [2.0; 3] }).collect();
        let filled = fill(&time, &rows, &rows);
        assert_eq!(filled.gyr[..15], rows[..15]);
        assert!(filled.held[..15].iter().all(|h| !h));
    }
}
