//! The linear solution against a dense one.

use imufast_core::orientation::smoother::{
    arrowhead::{Arrowhead, Border, Node},
    marginals::{chain_marginals, marginals},
    residual::CONSTANTS,
};
use nalgebra::{DMatrix, DVector, Matrix3, SVector, Vector3};

use crate::data::Random;

/// A random system and the same as dense matrices: residuals of neighbours and the border.
fn system(count: usize, broken: usize, random: &mut Random) -> (Arrowhead, DMatrix<f64>, DVector<f64>) {
    let size = 3 * count + CONSTANTS;
    let mut dense = DMatrix::identity(size, size) * 0.1;
    for k in 0..count {
        let wide = if k + 1 < count && k != broken { 6 } else { 3 };
        let j = DMatrix::from_fn(4, size, |_, c| {
            let own = c >= 3 * k && c < 3 * k + wide;
            if own || c >= 3 * count { random.normal() } else { 0.0 }
        });
        dense += j.tr_mul(&j);
    }
    let gradient = DVector::from_fn(size, |_, _| random.normal());
    let nodes = (0..count)
        .map(|k| Node {
            diagonal: dense.fixed_view::<3, 3>(3 * k, 3 * k).into(),
            next: if k + 1 < count { dense.fixed_view::<3, 3>(3 * k, 3 * k + 3).into() } else { Matrix3::zeros() },
            border: [0, 1, 2].map(|r| core::array::from_fn(|c| dense[(3 * k + r, 3 * count + c)])),
            gradient: gradient.fixed_rows::<3>(3 * k).into(),
        })
        .collect();
    let border: Border = dense.fixed_view::<CONSTANTS, CONSTANTS>(3 * count, 3 * count).into();
    let last: SVector<f64, CONSTANTS> = gradient.fixed_rows::<CONSTANTS>(3 * count).into();
    (Arrowhead { nodes, border, gradient: last }, dense, gradient)
}

#[test]
fn steps_determinant_and_marginals_are_those_of_the_dense_system() {
    let mut random = Random(7);
    for (count, broken) in [(1, 9), (2, 9), (2, 0), (12, 99), (12, 5)] {
        let (arrow, dense, gradient) = system(count, broken, &mut random);
        let eliminated = arrow.eliminate().expect("positive definite");
        let cholesky = dense.clone().cholesky().expect("positive definite");
        let (steps, border) = eliminated.step();
        let expected = -cholesky.solve(&gradient);
        let inverse = cholesky.inverse();
        let chain = dense.view((0, 0), (3 * count, 3 * count)).into_owned().cholesky().expect("positive definite").inverse();
        let same = |a: &Matrix3<f64>, b: &DMatrix<f64>, r: usize, c: usize| {
            let b: Matrix3<f64> = b.fixed_view::<3, 3>(r, c).into();
            assert!((a - b).norm() < 1e-9 * (1.0 + b.norm()), "{a} {b}");
        };
        let (all, given) = (marginals(&eliminated), chain_marginals(&eliminated));
        for k in 0..count {
            let step: Vector3<f64> = expected.fixed_rows::<3>(3 * k).into();
            assert!((steps[k] - step).norm() < 1e-9);
            same(&all[k].own, &inverse, 3 * k, 3 * k);
            same(&given[k].own, &chain, 3 * k, 3 * k);
            if k + 1 < count {
                same(&all[k].with_next, &inverse, 3 * k, 3 * k + 3);
                same(&given[k].with_next, &chain, 3 * k, 3 * k + 3);
            }
        }
        for i in 0..CONSTANTS {
            assert!((border[i] - expected[3 * count + i]).abs() < 1e-9);
            for j in 0..CONSTANTS {
                assert!((eliminated.border[(i, j)] - inverse[(3 * count + i, 3 * count + j)]).abs() < 1e-9);
            }
        }
        let log_det = 2.0 * cholesky.l().diagonal().map(f64::ln).sum();
        assert!((eliminated.log_det - log_det).abs() < 1e-8);
    }
}

#[test]
fn what_is_not_positive_definite_is_refused() {
    let (arrow, _, _) = system(4, 99, &mut Random(8));
    let mut flat = arrow.clone();
    flat.nodes[2].diagonal = Matrix3::zeros();
    assert!(flat.eliminate().is_none());
    let mut nan = arrow;
    nan.border[(3, 3)] = f64::NAN;
    assert!(nan.eliminate().is_none());
}
