//! Algorithm 3, lines 5–10: accelerometer rows that say most loudly what others say too are given up, worst score first.

use alloc::{vec, vec::Vec};
use nalgebra::{ComplexField, Matrix6, SymmetricEigen, Vector6};

/// Marks the rows to keep: `rows` (eq. 53) with their scores (eq. 46) are pruned until `keep` are left. Each round removes, of
/// the rows whose coherence with the leading right singular vector of A exceeds 0.5 (eq. 52), the one with the largest score
/// (the first of equals). Where coherence is so evenly spread that no row exceeds 0.5, no direction is over-represented and
/// the score alone decides.
///
/// The Gram matrix loses one rank-one term a round and its leading eigenvector is tracked, so a round costs a few small
/// solves and a walk down the worst scores, not a decomposition of all rows.
pub fn prune(rows: &[Vector6<f64>], scores: &[f64], keep: usize) -> Vec<bool> {
    let count = rows.len();
    let mut kept = vec![true; count];
    if count <= keep {
        return kept;
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
    // A chain through the rows still there, worst score first; place `count` is its head.
    let mut next: Vec<usize> = (1..=count).collect();
    next.push(0);
    let norms: Vec<f64> = rows.iter().map(Vector6::norm).collect();
    let mut gram: Matrix6<f64> = rows.iter().map(|row| row * row.transpose()).sum();
    let mut leading = leading_eigenvector(&gram, None);
    // A row's coherence changes no faster than the eigenvector turns, so it need not be looked at before that much turning.
    let (mut turned, mut not_before) = (0.0, vec![0.0; count]);
    for _ in 0..count - keep {
        let mut before = count;
        let mut at = next[count];
        while at < count {
            let k = order[at];
            if turned >= not_before[at] {
                let coherence = ComplexField::abs(rows[k].dot(&leading)) / norms[k];
                if coherence > 0.5 {
                    break;
                }
                not_before[at] = turned + 0.999 * (0.5 - coherence);
            }
            (before, at) = (at, next[at]);
        }
        if at == count {
            (before, at) = (count, next[count]);
        }
        let k = order[at];
        kept[k] = false;
        next[before] = next[at];
        gram -= rows[k] * rows[k].transpose();
        let turned_to = leading_eigenvector(&gram, Some(&leading));
        turned += (turned_to - leading).norm().min((turned_to + leading).norm());
        leading = turned_to;
    }
    kept
}

/// Unit eigenvector of the largest eigenvalue. From a close guess two or three steps of Rayleigh quotient iteration reach
/// rounding; that nothing larger exists is then checked, and only if something does, all eigenvectors are computed.
pub fn leading_eigenvector(gram: &Matrix6<f64>, guess: Option<&Vector6<f64>>) -> Vector6<f64> {
    if let Some(found) = guess.and_then(|guess| rayleigh(gram, guess)) {
        return found;
    }
    let all = SymmetricEigen::new(*gram);
    all.eigenvectors.column(all.eigenvalues.imax()).into()
}

fn rayleigh(gram: &Matrix6<f64>, guess: &Vector6<f64>) -> Option<Vector6<f64>> {
    let mut w = *guess;
    for _ in 0..8 {
        let image = gram * w;
        let value = w.dot(&image);
        if (image - w * value).norm() <= 1e-14 * value {
            let above = Matrix6::identity() * (value * (1.0 + 1e-10)) - gram;
            return above.cholesky().map(|_| w);
        }
        // Exactly at an eigenvalue the system is singular; a hair beside it the solution has the same direction.
        let shifted = gram - Matrix6::identity() * (value * (1.0 + 1e-16));
        w = shifted.lu().solve(&w)?.try_normalize(0.0)?;
        if !w.iter().all(|x| x.is_finite()) {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: usize, spread: f64) -> (Vec<Vector6<f64>>, Vec<f64>) {
        let noise = |k: usize| ((k as f64 * 12.9898).sin() * 43758.5453).fract();
        let row = |k: usize| Vector6::from_fn(|c, _| if c == k % 3 { 9.0 } else { 0.0 } + spread * noise(6 * k + c));
        ((0..count).map(row).collect(), (0..count).map(|k| (noise(k + 77).abs() * 20.0).round()).collect())
    }

    /// The loop as the paper writes it, with a decomposition each round.
    fn literal(rows: &[Vector6<f64>], scores: &[f64], keep: usize) -> Vec<bool> {
        let mut kept = vec![true; rows.len()];
        let left = |kept: &[bool]| (0..kept.len()).filter(|&k| kept[k]).collect::<Vec<_>>();
        while left(&kept).len() > keep {
            let gram: Matrix6<f64> = left(&kept).iter().map(|&k| rows[k] * rows[k].transpose()).sum();
            let w = leading_eigenvector(&gram, None);
            let coherent = |k: &usize| (rows[*k].dot(&w)).abs() / rows[*k].norm() > 0.5;
            let mut pool: Vec<usize> = left(&kept).into_iter().filter(coherent).collect();
            if pool.is_empty() {
                pool = left(&kept);
            }
            let worst = pool.iter().copied().reduce(|a, b| if scores[b] > scores[a] { b } else { a });
            kept[worst.unwrap_or(0)] = false;
        }
        kept
    }

    #[test]
    fn removes_exactly_what_the_literal_loop_removes() {
        for (count, keep, spread) in [(60, 10, 0.5), (300, 40, 3.0), (300, 7, 12.0), (40, 1, 1.0)] {
            let (rows, scores) = rows(count, spread);
            assert_eq!(prune(&rows, &scores, keep), literal(&rows, &scores, keep));
        }
    }

    #[test]
    fn zero_rows_and_ties_end_too() {
        let rows = vec![Vector6::zeros(); 9];
        let kept = prune(&rows, &[1.0; 9], 4);
        assert_eq!(kept, [false, false, false, false, false, true, true, true, true]);
    }
}
