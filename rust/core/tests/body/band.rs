//! The banded solution against a dense one.

use imufast_core::body::{
    band::{Band, triangle, upper},
    marginals::{SHARED, marginals},
    tiles::N,
};
use nalgebra::{DMatrix, DVector};

use crate::data::Random;

/// Residuals of single nodes, of a sensor at neighbouring nodes, and of the border; the same dense. Only `hold` tells where and
/// how fast the whole is: what is added to the shared unknowns of all sensors at a node, and what follows from it at the next,
/// no other residual sees.
fn system(
    count: usize,
    sensors: usize,
    constants: usize,
    broken: usize,
    hold: f64,
    random: &mut Random,
) -> (Band, DMatrix<f64>, DVector<f64>) {
    let (rows, size) = (sensors * N, count * sensors * N + constants);
    let border = count * rows;
    let shared = SHARED.len();
    let mut h = DMatrix::zeros(size, size);
    for k in 0..count {
        let first = k * rows + SHARED.start;
        let mut j = DMatrix::from_fn(7, size, |_, c| if c >= border || c / rows == k { 0.4 * random.normal() } else { 0.0 });
        j.columns_mut(first, shared).fill(0.0);
        for s in 1..sensors {
            let other = j.columns(first + s * N, shared).into_owned();
            j.columns_mut(first, shared).zip_apply(&other, |v, o| *v -= o);
        }
        for s in 1..sensors {
            // Every shared unknown less the first sensor's is known a little.
            for a in 0..shared {
                j = j.insert_row(0, 0.0);
                (j[(0, first + a)], j[(0, first + s * N + a)]) = (-0.5, 0.5);
            }
        }
        h += j.tr_mul(&j);
        let onward = DMatrix::from_fn(shared, shared, |a, b| f64::from(u8::from(a == b)) + 0.05 * random.normal());
        for s in 0..sensors {
            let from = k * rows + s * N;
            if k + 1 < count && k != broken {
                let mut j = DMatrix::zeros(N, size);
                j.columns_mut(from, N).apply(|v| *v = random.normal());
                j.columns_mut(from + rows, N).apply(|v| *v = random.normal());
                let after = j.columns(from + rows + SHARED.start, shared) * -&onward;
                j.columns_mut(from + SHARED.start, shared).copy_from(&after);
                h += j.tr_mul(&j);
            }
        }
        for a in (k * rows..(k + 1) * rows).filter(|a| !SHARED.contains(&(a % N))) {
            h[(a, a)] += 0.3;
        }
        if k == 0 || k == broken + 1 {
            (first..first + shared).for_each(|a| h[(a, a)] += hold);
        }
    }
    (border..size).for_each(|a| h[(a, a)] += 0.3);
    let g = DVector::from_fn(size, |_, _| random.normal());
    let mut band = Band::new(count, sensors, constants);
    let (tile, column) = band.gradient_place();
    for k in 0..count {
        band.linked[k] = k + 1 < count && k != broken;
        for j in 0..sensors {
            let at = k * rows + j * N;
            for i in 0..=j {
                let target = &mut band.diagonal[k * triangle(sensors) + upper(i, j)];
                target.0 = core::array::from_fn(|a| core::array::from_fn(|b| h[(k * rows + i * N + a, at + b)]));
            }
            if band.linked[k] {
                band.next[k * sensors + j].0 = core::array::from_fn(|a| core::array::from_fn(|b| h[(at + a, at + rows + b)]));
            }
            for c in 0..constants {
                let target = &mut band.border[(k * sensors + j) * band.wide + c / N];
                (0..N).for_each(|a| target.0[a][c % N] = h[(at + a, border + c)]);
            }
            let target = &mut band.border[(k * sensors + j) * band.wide + tile];
            (0..N).for_each(|a| target.0[a][column] = g[at + a]);
        }
    }
    for j in 0..constants {
        for i in 0..=j {
            band.corner[upper(i / N, j / N)].0[i % N][j % N] = h[(border + i, border + j)];
        }
        band.corner[upper(j / N, tile)].0[j % N][column] = g[border + j];
    }
    (band, h, g)
}

#[test]
fn the_step_and_its_promise_are_those_of_the_dense_system() {
    let mut random = Random(11);
    for (count, sensors, constants, broken) in [(5, 3, 20, 9), (6, 2, 15, 2), (4, 1, 0, 9), (3, 2, 16, 0)] {
        let (mut band, h, g) = system(count, sensors, constants, broken, 0.3, &mut random);
        assert!((0..count).all(|k| band.eliminate(k)));
        let found = band.solve().expect("it is positive definite");
        let expected = -h.clone().cholesky().expect("it is positive definite").solve(&g);
        let size = count * sensors * N;
        for k in 0..size {
            assert!((found.steps[k] - expected[k]).abs() < 1e-10, "{k}: {} {}", found.steps[k], expected[k]);
        }
        (0..constants).for_each(|k| assert!((found.border[k] - expected[size + k]).abs() < 1e-10));
        assert!((found.decrement + g.dot(&expected)).abs() < 1e-9);
    }
}

#[test]
fn what_is_not_positive_definite_is_refused() {
    let mut random = Random(12);
    let (mut band, ..) = system(3, 2, 5, 9, 0.3, &mut random);
    band.diagonal[triangle(2)].0[4][4] = -1.0;
    assert!(band.eliminate(0));
    assert!(!band.eliminate(1));
}

/// Shared unknowns less those of the first sensor.
fn between(count: usize, sensors: usize, constants: usize) -> DMatrix<f64> {
    let size = count * sensors * N + constants;
    let mut between = DMatrix::identity(size, size);
    for row in (0..count * sensors * N).filter(|row| SHARED.contains(&(row % N))) {
        between[(row, row - (row / N) % sensors * N)] -= 1.0;
    }
    between
}

/// With the whole known to no better than a standard deviation of thirty or a thousand kilometres.
#[test]
fn marginals_are_blocks_of_the_inverse_between_the_sensors() {
    for (count, sensors, constants, broken) in [(4, 3, 20, 9), (4, 2, 15, 1), (3, 1, 0, 9), (3, 2, 16, 9), (8, 2, 4, 5)] {
        let (_, h, _) = system(count, sensors, constants, broken, 0.3, &mut Random(13));
        let between = between(count, sensors, constants);
        let inverse = &between * h.try_inverse().expect("it is positive definite") * between.transpose();
        let border = count * sensors * N;
        for hold in [1e-9, 1e-12] {
            let (mut band, ..) = system(count, sensors, constants, broken, hold, &mut Random(13));
            assert!((0..count).all(|k| band.eliminate(k)));
            let mut seen = 0;
            let covariance = marginals(&band, None, |k, marginal| {
                seen += 1;
                for i in 0..sensors {
                    for a in 0..N {
                        let row = (k * sensors + i) * N + a;
                        for j in 0..sensors {
                            for b in 0..N {
                                let expected = inverse[(row, (k * sensors + j) * N + b)];
                                assert!(
                                    (marginal.own([i, j], a, b) - expected).abs() < 1e-8,
                                    "{hold} {k} {} {expected}",
                                    marginal.own([i, j], a, b)
                                );
                            }
                        }
                        for c in 0..constants {
                            assert!((marginal.beside(i, a, c) - inverse[(row, border + c)]).abs() < 1e-8, "{hold} {k}");
                        }
                    }
                }
            });
            let covariance = covariance.expect("it is positive definite");
            assert_eq!(seen, count);
            for i in 0..constants {
                for j in 0..constants {
                    assert!((covariance[i * constants + j] - inverse[(border + i, border + j)]).abs() < 1e-8);
                }
            }
        }
    }
}
