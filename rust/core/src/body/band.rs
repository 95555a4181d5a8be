//! Symmetric systems of a chain of dense blocks, each coupled to the next sensor by sensor, and all of them to one border.
//!
//! A node is one moment: one tile a sensor, dense among them. From a moment to the next a sensor is tied to itself alone, so the
//! coupling is block diagonal, which halves the work: `U = R⁻ᵀ B` of a block-diagonal `B` is lower triangular by tiles. Gradients
//! ride along as one more column of the border, so that forward substitution costs nothing of its own. U is not kept but made
//! anew where it is needed: `U x = R⁻ᵀ (B x)`.

use alloc::{vec, vec::Vec};
use nalgebra::ComplexField;

use super::tiles::{N, Tile, Width, factor, solve_lower, solve_lower_one, solve_upper_one, sub};

/// `(H + damping) δ = −g` on its way to a solution.
#[derive(Clone, Debug)]
pub struct Band {
    /// Tiles (sensors) of a node.
    pub sensors: usize,
    /// Unknowns of the border.
    pub constants: usize,
    /// Tiles of the border, which hold its unknowns and one column more: the gradient.
    pub wide: usize,
    /// Number of nodes.
    pub count: usize,
    /// Upper triangle of each node's block by tiles, columns one after the other; after elimination R.
    pub diagonal: Vec<Tile>,
    /// Tile of each sensor with itself at the next node.
    pub next: Vec<Tile>,
    /// Whether a node is tied to the next.
    pub linked: Vec<bool>,
    /// Rows of each node by tiles of the border.
    pub border: Vec<Tile>,
    /// Upper triangle of the border's own block.
    pub corner: Vec<Tile>,
    width: Width,
    work: Vec<Tile>,
}

/// Place of tile (i, j), i ≤ j, in an upper triangle.
#[inline]
pub fn upper(i: usize, j: usize) -> usize {
    j * (j + 1) / 2 + i
}

/// Number of tiles in an upper triangle.
#[inline]
pub fn triangle(n: usize) -> usize {
    n * (n + 1) / 2
}

/// What comes of elimination.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Step of every node, a tile's row for each sensor.
    pub steps: Vec<f64>,
    /// Step of the border.
    pub border: Vec<f64>,
    /// `gᵀ (H + damping)⁻¹ g`: twice the decrease that the damped quadratic model promises.
    pub decrement: f64,
}

impl Band {
    /// For so many nodes.
    pub fn new(count: usize, sensors: usize, constants: usize) -> Self {
        let wide = constants / N + 1;
        Self {
            sensors,
            constants,
            wide,
            count,
            diagonal: vec![Tile::ZERO; count * triangle(sensors)],
            next: vec![Tile::ZERO; count * sensors],
            linked: vec![false; count],
            border: vec![Tile::ZERO; count * sensors * wide],
            corner: vec![Tile::ZERO; triangle(wide)],
            width: Width::here(),
            work: vec![Tile::ZERO; triangle(sensors)],
        }
    }

    /// Tile and column of the gradient.
    pub fn gradient_place(&self) -> (usize, usize) {
        (self.constants / N, self.constants % N)
    }

    /// The registers to compute with.
    pub fn width(&self) -> Width {
        self.width
    }

    /// Empties it.
    pub fn clear(&mut self) {
        for tiles in [&mut self.diagonal, &mut self.next, &mut self.border, &mut self.corner] {
            tiles.fill(Tile::ZERO);
        }
        self.linked.fill(false);
    }

    /// Eliminates node `k`, whose rows are complete; false where the matrix is not positive definite.
    pub fn eliminate(&mut self, k: usize) -> bool {
        let (s, wide, width, tri) = (self.sensors, self.wide, self.width, triangle(self.sensors));
        let (here, after) = self.diagonal[k * tri..].split_at_mut(tri);
        for j in 0..s {
            for i in 0..=j {
                let (left, column) = here.split_at_mut(upper(0, j));
                let (above, rest) = column.split_at_mut(i);
                let tile = &mut rest[0];
                for (m, above) in above.iter().enumerate() {
                    // The column of tile i, for i = j this very column.
                    let other = if i == j { above } else { &left[upper(m, i)] };
                    sub(width, tile, &other.0, &above.0);
                }
                if i == j {
                    if !factor(width, tile, 0.0) {
                        return false;
                    }
                } else {
                    solve_lower(width, &left[upper(i, i)], tile);
                }
            }
        }
        let (rows, rows_after) = self.border[k * s * wide..].split_at_mut(s * wide);
        for i in 0..s {
            let (done, row) = rows.split_at_mut(i * wide);
            for (c, tile) in row[..wide].iter_mut().enumerate() {
                for m in 0..i {
                    sub(width, tile, &here[upper(m, i)].0, &done[m * wide + c].0);
                }
                solve_lower(width, &here[upper(i, i)], tile);
            }
        }
        for c in 0..wide {
            for b in 0..=c {
                let tile = &mut self.corner[upper(b, c)];
                for i in 0..s {
                    sub(width, tile, &rows[i * wide + b].0, &rows[i * wide + c].0);
                }
            }
        }
        if !self.linked[k] {
            return true;
        }
        // U, tile (i, j) with i ≥ j at upper(j, i).
        let (u, next) = (&mut self.work, &self.next[k * s..(k + 1) * s]);
        for j in 0..s {
            for i in j..s {
                let mut tile = if i == j { next[j] } else { Tile::ZERO };
                for m in j..i {
                    sub(width, &mut tile, &here[upper(m, i)].0, &u[upper(j, m)].0);
                }
                solve_lower(width, &here[upper(i, i)], &mut tile);
                u[upper(j, i)] = tile;
            }
        }
        for j in 0..s {
            for i in 0..=j {
                for m in j..s {
                    sub(width, &mut after[upper(i, j)], &u[upper(i, m)].0, &u[upper(j, m)].0);
                }
            }
            for c in 0..wide {
                for m in j..s {
                    sub(width, &mut rows_after[j * wide + c], &u[upper(j, m)].0, &rows[m * wide + c].0);
                }
            }
        }
        true
    }

    /// What is left of the border once all nodes are eliminated, as a dense lower triangle L with `L Lᵀ`; None where that is not
    /// positive definite.
    pub fn corner_factor(&self) -> Option<Vec<f64>> {
        let n = self.constants;
        let mut l = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                l[i * n + j] = self.corner_at(j, i);
            }
        }
        cholesky(&mut l, n).then_some(l)
    }

    /// Element (i, j), i ≤ j, of the border's block; column `constants` is its gradient.
    pub fn corner_at(&self, i: usize, j: usize) -> f64 {
        self.corner[upper(i / N, j / N)].0[i % N][j % N]
    }

    /// The step, after all nodes are eliminated.
    pub fn solve(&self) -> Option<Solution> {
        let n = self.constants;
        let l = self.corner_factor()?;
        let mut border: Vec<f64> = (0..n).map(|i| -self.corner_at(i, n)).collect();
        forward(&l, n, &mut border);
        let rest: f64 = border.iter().map(|v| v * v).sum();
        backward(&l, n, &mut border);
        let (s, wide, tri) = (self.sensors, self.wide, triangle(self.sensors));
        let mut beside = vec![0.0; wide * N];
        beside[..n].copy_from_slice(&border);
        beside[n] = 1.0;
        let mut steps = vec![0.0; self.count * s * N];
        let mut coupled = vec![0.0; s * N];
        for k in (0..self.count).rev() {
            let r = &self.diagonal[k * tri..(k + 1) * tri];
            let (before, after) = steps.split_at_mut((k + 1) * s * N);
            let x = &mut before[k * s * N..];
            coupled.fill(0.0);
            if self.linked[k] {
                for i in 0..s {
                    let tile = &self.next[k * s + i];
                    for (row, value) in tile.0.iter().zip(&mut coupled[i * N..(i + 1) * N]) {
                        *value = row.iter().zip(&after[i * N..(i + 1) * N]).map(|(a, b)| a * b).sum();
                    }
                }
                for i in 0..s {
                    let (done, own) = coupled.split_at_mut(i * N);
                    for (m, done) in done.chunks_exact(N).enumerate() {
                        for (row, factor) in r[upper(m, i)].0.iter().zip(done) {
                            own[..N].iter_mut().zip(row).for_each(|(v, t)| *v -= t * factor);
                        }
                    }
                    solve_lower_one(&r[upper(i, i)], &mut own[..N]);
                }
            }
            for i in 0..s {
                let rows = &self.border[(k * s + i) * wide..(k * s + i + 1) * wide];
                for a in 0..N {
                    let side: f64 = rows.iter().zip(beside.chunks_exact(N)).map(|(tile, b)| dot(&tile.0[a], b)).sum::<f64>();
                    x[i * N + a] = -(side + coupled[i * N + a]);
                }
            }
            for i in (0..s).rev() {
                let (own, below) = x.split_at_mut((i + 1) * N);
                let own = &mut own[i * N..];
                for (m, below) in below.chunks_exact(N).enumerate() {
                    for (row, v) in r[upper(i, i + 1 + m)].0.iter().zip(own.iter_mut()) {
                        *v -= dot(row, below);
                    }
                }
                solve_upper_one(&r[upper(i, i)], own);
            }
        }
        // The corner's last diagonal element has gathered −gᵀH⁻¹g of the nodes.
        let decrement = rest - self.corner_at(n, n);
        Some(Solution { steps, border, decrement })
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Lower triangle, rows one after the other, as L with `L Lᵀ`; false where it is not positive definite.
pub fn cholesky(l: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        for j in 0..=i {
            let (head, tail) = l.split_at_mut(i * n);
            let row = &tail[..n];
            let left = if i == j { dot(&row[..j], &row[..j]) } else { dot(&row[..j], &head[j * n..j * n + j]) };
            let value = row[j] - left;
            if i == j {
                if value.is_nan() || value <= 0.0 || value.is_infinite() {
                    return false;
                }
                l[i * n + i] = ComplexField::sqrt(value);
            } else {
                l[i * n + j] = value / l[j * n + j];
            }
        }
    }
    true
}

/// `x ← L⁻¹ x`.
pub fn forward(l: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        x[i] = (x[i] - dot(&l[i * n..i * n + i], &x[..i])) / l[i * n + i];
    }
}

/// `x ← L⁻ᵀ x`.
pub fn backward(l: &[f64], n: usize, x: &mut [f64]) {
    for i in (0..n).rev() {
        x[i] /= l[i * n + i];
        let value = x[i];
        x[..i].iter_mut().zip(&l[i * n..i * n + i]).for_each(|(v, t)| *v -= t * value);
    }
}
