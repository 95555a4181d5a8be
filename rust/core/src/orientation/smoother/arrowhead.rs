//! Symmetric systems of a chain of 3×3 blocks, each coupled to the next and to one border: solved in one pass forward and
//! one back, so in time linear in the length of the chain.

use alloc::vec::Vec;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::residual::CONSTANTS;

/// Three rows as wide as the border.
pub type Wide = [[f64; CONSTANTS]; 3];
/// The border's own block.
pub type Border = SMatrix<f64, CONSTANTS, CONSTANTS>;

/// Block row k of the system. After elimination, with `D_k = L Lᵀ` what is left of its diagonal block: `L`, and `L⁻¹` times
/// the rest.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// H_kk.
    pub diagonal: Matrix3<f64>,
    /// H_k,k+1; zero where the chain is broken.
    pub next: Matrix3<f64>,
    /// H_kb.
    pub border: Wide,
    /// Gradient.
    pub gradient: Vector3<f64>,
}

impl Node {
    /// Nothing.
    pub const ZERO: Self = Self {
        diagonal: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        next: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        border: [[0.0; CONSTANTS]; 3],
        gradient: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// `H δ = −g`.
#[derive(Clone, Debug)]
pub struct Arrowhead {
    /// The chain.
    pub nodes: Vec<Node>,
    /// H_bb.
    pub border: Border,
    /// Gradient of the border.
    pub gradient: SVector<f64, CONSTANTS>,
}

/// An eliminated system.
#[derive(Clone, Debug)]
pub struct Eliminated {
    pub(super) nodes: Vec<Node>,
    /// Inverse of what is left of the border: the covariance of the constants.
    pub border: Border,
    gradient: SVector<f64, CONSTANTS>,
    /// log det H.
    pub log_det: f64,
}

impl Arrowhead {
    /// Eliminates the chain, node by node; None where the matrix is not positive definite.
    pub fn eliminate(mut self) -> Option<Eliminated> {
        let mut log_det = 0.0;
        let mut border = [[0.0; CONSTANTS]; CONSTANTS];
        for (i, row) in border.iter_mut().enumerate() {
            for (j, v) in row.iter_mut().enumerate() {
                *v = self.border[(i, j)];
            }
        }
        let mut gradient = self.gradient;
        for k in 0..self.nodes.len() {
            let (done, rest) = self.nodes.split_at_mut(k + 1);
            let node = &mut done[k];
            let l = node.diagonal.cholesky()?.unpack();
            log_det += 2.0 * (nalgebra::ComplexField::ln(l[(0, 0)] * l[(1, 1)] * l[(2, 2)]));
            node.diagonal = l;
            let (d0, d1, d2) = (1.0 / l[(0, 0)], 1.0 / l[(1, 1)], 1.0 / l[(2, 2)]);
            let (l10, l20, l21) = (l[(1, 0)], l[(2, 0)], l[(2, 1)]);
            let forward = |v: [f64; 3]| {
                let a = v[0] * d0;
                let b = (v[1] - l10 * a) * d1;
                [a, b, (v[2] - l20 * a - l21 * b) * d2]
            };
            let [u0, u1, u2] = &mut node.border;
            for ((a, b), c) in u0.iter_mut().zip(u1.iter_mut()).zip(u2.iter_mut()) {
                [*a, *b, *c] = forward([*a, *b, *c]);
            }
            node.gradient = Vector3::from(forward(node.gradient.into()));
            for (i, row) in border.iter_mut().enumerate() {
                let (a, b, c) = (u0[i], u1[i], u2[i]);
                for (((v, x), y), z) in row.iter_mut().zip(u0.iter()).zip(u1.iter()).zip(u2.iter()) {
                    *v -= a * x + b * y + c * z;
                }
                gradient[i] -= a * node.gradient.x + b * node.gradient.y + c * node.gradient.z;
            }
            if let Some(after) = rest.first_mut() {
                for c in 0..3 {
                    let column = forward([node.next[(0, c)], node.next[(1, c)], node.next[(2, c)]]);
                    node.next.set_column(c, &Vector3::from(column));
                }
                after.diagonal -= node.next.tr_mul(&node.next);
                after.gradient -= node.next.tr_mul(&node.gradient);
                for (r, row) in after.border.iter_mut().enumerate() {
                    let (a, b, c) = (node.next[(0, r)], node.next[(1, r)], node.next[(2, r)]);
                    for (((v, x), y), z) in
                        row.iter_mut().zip(node.border[0].iter()).zip(node.border[1].iter()).zip(node.border[2].iter())
                    {
                        *v -= a * x + b * y + c * z;
                    }
                }
            }
        }
        let left = Border::from_fn(|i, j| 0.5 * (border[i][j] + border[j][i])).cholesky()?;
        log_det += 2.0 * (0..CONSTANTS).map(|i| nalgebra::ComplexField::ln(left.l_dirty()[(i, i)])).sum::<f64>();
        if !log_det.is_finite() {
            return None;
        }
        Some(Eliminated { nodes: self.nodes, border: left.inverse(), gradient, log_det })
    }
}

impl Eliminated {
    /// The step: of every node, and of the border.
    pub fn step(&self) -> (Vec<Vector3<f64>>, SVector<f64, CONSTANTS>) {
        let border = -(self.border * self.gradient);
        let mut steps = alloc::vec![Vector3::zeros(); self.nodes.len()];
        let mut after = Vector3::zeros();
        for (node, step) in self.nodes.iter().zip(&mut steps).rev() {
            let mut right = node.gradient + node.next * after;
            for (r, row) in node.border.iter().enumerate() {
                right[r] += row.iter().zip(border.iter()).map(|(a, b)| a * b).sum::<f64>();
            }
            after = -back(&node.diagonal, right);
            *step = after;
        }
        (steps, border)
    }
}

/// `L⁻ᵀ v`.
pub(super) fn back(l: &Matrix3<f64>, v: Vector3<f64>) -> Vector3<f64> {
    let c = v.z / l[(2, 2)];
    let b = (v.y - l[(2, 1)] * c) / l[(1, 1)];
    Vector3::new((v.x - l[(1, 0)] * b - l[(2, 0)] * c) / l[(0, 0)], b, c)
}
