//! Marginal covariances, node by node from the last to the first (Rauch, Tung & Striebel 1965), by the same tiles.
//!
//! Given the next node x' and the border b, a node is `−R⁻¹(U x' + U_b b)` with covariance `R⁻¹R⁻ᵀ`. With `G = R⁻¹U`,
//! `G_b = R⁻¹U_b`, and P', C', B the covariances of x', of x' with b, and of b:
//! `C = −(G C' + G_b B)`, `P = R⁻¹R⁻ᵀ + G (G P' + G_b C'ᵀ)ᵀ − G_b Cᵀ`.
//!
//! Where the whole body is and how fast it moves, nothing tells: variances of up to a square kilometre, in the rounding of which
//! all that is between the sensors drowns within minutes. So velocities and positions are taken from the first sensor's: with Π
//! for that, `Π G = Π G Π` where nothing holds the whole, because what shifts all sensors alike at one moment does so at the next,
//! and the recursion holds for `Π P Πᵀ` with `Π R⁻¹`, `Π G`, `Π G_b`.

use alloc::{vec, vec::Vec};

use super::{
    band::{Band, backward, forward, triangle, upper},
    states::{POSITION, VELOCITY},
    tiles::{N, Tile, solve_lower, solve_upper, sub, sub_plain},
};

/// Unknowns of a sensor that are told from those of the first sensor.
pub const SHARED: core::ops::Range<usize> = VELOCITY..POSITION + 3;

/// Covariances of one node; of velocities and positions, of what they are more than the first sensor's.
pub struct Marginal<'a> {
    sensors: usize,
    wide: usize,
    /// Of the node, all tiles by rows.
    own: &'a [Tile],
    /// Of the node with the border, tiles by rows.
    beside: &'a [Tile],
}

impl Marginal<'_> {
    /// Covariance of unknown `a` of one sensor with unknown `b` of another.
    pub fn own(&self, sensors: [usize; 2], a: usize, b: usize) -> f64 {
        self.own[sensors[0] * self.sensors + sensors[1]].0[a][b]
    }

    /// Covariance of unknown `a` of a sensor with a place in the border.
    pub fn beside(&self, sensor: usize, a: usize, place: usize) -> f64 {
        self.beside[sensor * self.wide + place / N].0[a][place % N]
    }
}

/// Covariance of the border, rows one after the other; None where nothing holds it.
pub fn border_covariance(band: &Band) -> Option<Vec<f64>> {
    let n = band.constants;
    let l = band.corner_factor()?;
    let mut covariance = vec![0.0; n * n];
    for (i, row) in covariance.chunks_exact_mut(n.max(1)).enumerate() {
        row[i] = 1.0;
        forward(&l, n, row);
        backward(&l, n, row);
    }
    Some(covariance)
}

/// Tells `take` the marginals of each node of an eliminated band, the last first. Returns the covariance of the border: that
/// which is `stated`, where it is, else what the band says.
pub fn marginals(band: &Band, stated: Option<&[f64]>, mut take: impl FnMut(usize, &Marginal<'_>)) -> Option<Vec<f64>> {
    let (s, wide, n, width, tri) = (band.sensors, band.wide, band.constants, band.width(), triangle(band.sensors));
    let covariance = match stated {
        Some(covariance) => covariance.to_vec(),
        None => border_covariance(band)?,
    };
    let mut border = vec![Tile::ZERO; wide * wide];
    for i in 0..n {
        for j in 0..n {
            border[(i / N) * wide + j / N].0[i % N][j % N] = covariance[i * n + j];
        }
    }
    let (mut own, mut beside) = (vec![Tile::ZERO; s * s], vec![Tile::ZERO; s * wide]);
    let mut across = vec![Tile::ZERO; wide * s];
    let mut turned = vec![Tile::ZERO; s * s];
    for k in (0..band.count).rev() {
        let r = &band.diagonal[k * tri..(k + 1) * tri];
        let mut g = vec![Tile::ZERO; s * s];
        if band.linked[k] {
            for j in 0..s {
                for i in j..s {
                    let mut tile = if i == j { band.next[k * s + j] } else { Tile::ZERO };
                    for m in j..i {
                        sub(width, &mut tile, &r[upper(m, i)].0, &g[m * s + j].0);
                    }
                    solve_lower(width, &r[upper(i, i)], &mut tile);
                    g[i * s + j] = tile;
                }
            }
        }
        let mut g_border = band.border[k * s * wide..(k + 1) * s * wide].to_vec();
        // The gradient's column, and what is beyond, is no unknown.
        for tile in g_border.iter_mut().skip(wide - 1).step_by(wide) {
            tile.0.iter_mut().for_each(|row| row[n % N..].fill(0.0));
        }
        let mut inverse = vec![Tile::ZERO; s * s];
        (0..s).for_each(|i| (0..N).for_each(|a| inverse[i * s + i].0[a][a] = 1.0));
        for (columns, x) in [(s, &mut g), (wide, &mut g_border), (s, &mut inverse)] {
            for i in (0..s).rev() {
                let (head, below) = x.split_at_mut((i + 1) * columns);
                for (j, tile) in head[i * columns..].iter_mut().enumerate() {
                    for m in i + 1..s {
                        sub_plain(width, tile, &r[upper(i, m)], &below[(m - i - 1) * columns + j]);
                    }
                    solve_upper(width, &r[upper(i, i)], tile);
                }
            }
            from_first(x, columns);
        }
        // −(G P' + G_b C'ᵀ), transposed into `turned`; C'ᵀ is still in `across`.
        for i in 0..s {
            for j in 0..s {
                let mut tile = Tile::ZERO;
                (0..s).for_each(|m| sub_plain(width, &mut tile, &g[i * s + m], &own[m * s + j]));
                (0..wide).for_each(|m| sub_plain(width, &mut tile, &g_border[i * wide + m], &across[m * s + j]));
                turned[j * s + i] = transposed(&tile);
            }
        }
        let mut now = vec![Tile::ZERO; s * wide];
        for i in 0..s {
            for c in 0..wide {
                let tile = &mut now[i * wide + c];
                (0..s).for_each(|m| sub_plain(width, tile, &g[i * s + m], &beside[m * wide + c]));
                (0..wide).for_each(|m| sub_plain(width, tile, &g_border[i * wide + m], &border[m * wide + c]));
            }
        }
        beside = now;
        for i in 0..s {
            (0..wide).for_each(|c| across[c * s + i] = transposed(&beside[i * wide + c]));
        }
        for j in 0..s {
            for i in 0..=j {
                let mut tile = Tile::ZERO;
                (0..s).for_each(|m| sub_plain(width, &mut tile, &g[i * s + m], &turned[m * s + j]));
                (0..wide).for_each(|m| sub_plain(width, &mut tile, &g_border[i * wide + m], &across[m * s + j]));
                for m in 0..s {
                    sub_plain(width, &mut tile, &inverse[i * s + m], &negative(&transposed(&inverse[j * s + m])));
                }
                own[j * s + i] = transposed(&tile);
                own[i * s + j] = tile;
            }
        }
        take(k, &Marginal { sensors: s, wide, own: &own, beside: &beside });
    }
    Some(covariance)
}

/// Rows of shared unknowns, less those of the first sensor; sensors one after the other, each of so many tiles.
fn from_first(rows: &mut [Tile], columns: usize) {
    let (first, others) = rows.split_at_mut(columns);
    for sensor in others.chunks_exact_mut(columns) {
        for (tile, first) in sensor.iter_mut().zip(first.iter()) {
            for a in SHARED {
                tile.0[a].iter_mut().zip(&first.0[a]).for_each(|(v, f)| *v -= f);
            }
        }
    }
    first.iter_mut().for_each(|tile| tile.0[SHARED].fill([0.0; N]));
}

fn transposed(tile: &Tile) -> Tile {
    Tile(core::array::from_fn(|i| core::array::from_fn(|j| tile.0[j][i])))
}

fn negative(tile: &Tile) -> Tile {
    Tile(tile.0.map(|row| row.map(|v| -v)))
}
