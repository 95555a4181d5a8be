//! Vectors, unit quaternions and symmetric 3×3 matrices over [`Lane`]s. Plain sums of products in a fixed order.

use super::lane::Lane;

/// x, y, z.
pub type Vec3<L> = [L; 3];
/// w, x, y, z.
pub type Quat<L> = [L; 4];
/// xx, xy, xz, yy, yz, zz.
pub type Sym3<L> = [L; 6];

#[inline(always)]
pub fn add<L: Lane>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub fn sub<L: Lane>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn scale<L: Lane>(a: Vec3<L>, s: L) -> Vec3<L> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub fn dot<L: Lane>(a: Vec3<L>, b: Vec3<L>) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub fn cross<L: Lane>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Hamilton product.
#[inline(always)]
pub fn mul<L: Lane>(a: Quat<L>, b: Quat<L>) -> Quat<L> {
    [
        (a[0] * b[0] - a[1] * b[1]) - (a[2] * b[2] + a[3] * b[3]),
        (a[0] * b[1] + a[1] * b[0]) + (a[2] * b[3] - a[3] * b[2]),
        (a[0] * b[2] + a[2] * b[0]) + (a[3] * b[1] - a[1] * b[3]),
        (a[0] * b[3] + a[3] * b[0]) + (a[1] * b[2] - a[2] * b[1]),
    ]
}

/// Hamilton product with a vector, `q ⊙ (0, v)`.
#[inline(always)]
pub fn mul_vector<L: Lane>(q: Quat<L>, v: Vec3<L>) -> Quat<L> {
    [
        -(q[1] * v[0] + q[2] * v[1] + q[3] * v[2]),
        q[0] * v[0] + (q[2] * v[2] - q[3] * v[1]),
        q[0] * v[1] + (q[3] * v[0] - q[1] * v[2]),
        q[0] * v[2] + (q[1] * v[1] - q[2] * v[0]),
    ]
}

/// `R(q)ᵀ v`.
#[inline(always)]
pub fn rotate_back<L: Lane>(q: Quat<L>, v: Vec3<L>) -> Vec3<L> {
    let u = [q[1], q[2], q[3]];
    // Twice v, not twice the product: the same bits, and v is often known before q.
    let t = cross(add(v, v), u);
    add(add(v, scale(t, q[0])), cross(t, u))
}

/// `exp_q(v/2)` of a rotation vector (eq. 6), by its power series: to the last bit up to 0.7 rad, to 1e-11 up to 2 rad.
#[inline(always)]
pub fn exp<L: Lane>(v: Vec3<L>) -> Quat<L> {
    let x = dot(v, v) * L::splat(0.25);
    let cos = series(x, [1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3_628_800.0, 1.0 / 479_001_600.0]);
    let sinc = series(
        x,
        [0.5, -1.0 / 12.0, 1.0 / 240.0, -1.0 / 10080.0, 1.0 / 725_760.0, -1.0 / 79_833_600.0, 1.0 / 12_454_041_600.0],
    );
    [cos, v[0] * sinc, v[1] * sinc, v[2] * sinc]
}

/// `Σ terms[k] xᵏ` in pairs, which wait less for each other than term after term.
#[inline(always)]
fn series<L: Lane>(x: L, [a, b, c, d, e, f, g]: [f64; 7]) -> L {
    let n = L::splat;
    let x2 = x * x;
    ((n(a) + n(b) * x) + (n(c) + n(d) * x) * x2) + ((n(e) + n(f) * x) + n(g) * x2) * (x2 * x2)
}

/// The opposite rotation.
#[inline(always)]
pub fn inverted<L: Lane>([w, x, y, z]: Quat<L>) -> Quat<L> {
    [w, -x, -y, -z]
}

/// The first-order step of eq. 5b as a factor: `(1, v/2)`.
#[inline(always)]
pub fn first_order<L: Lane>(v: Vec3<L>) -> Quat<L> {
    let half = L::splat(0.5);
    [L::splat(1.0), v[0] * half, v[1] * half, v[2] * half]
}

#[inline(always)]
pub fn dot4<L: Lane>(a: Quat<L>, b: Quat<L>) -> L {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}

#[inline(always)]
pub fn normalize<L: Lane>(q: Quat<L>) -> Quat<L> {
    let s = L::splat(1.0) / ((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3])).sqrt();
    [q[0] * s, q[1] * s, q[2] * s, q[3] * s]
}

/// Brings a length that is nearly one closer to it: from 1 + ε to 1 − 3ε²/2.
#[inline(always)]
pub fn nearly_unit<L: Lane>(q: Quat<L>) -> Quat<L> {
    let s = L::splat(1.5) - L::splat(0.5) * ((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]));
    [q[0] * s, q[1] * s, q[2] * s, q[3] * s]
}

/// Rows of `R(q)ᵀ`.
#[inline(always)]
pub fn rows_back<L: Lane>(q: Quat<L>) -> [Vec3<L>; 3] {
    let [w, x, y, z] = q;
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let (xx, yy, zz) = (x * x2, y * y2, z * z2);
    let (xy, xz, yz) = (x * y2, x * z2, y * z2);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    let one = L::splat(1.0);
    [[one - (yy + zz), xy + wz, xz - wy], [xy - wz, one - (xx + zz), yz + wx], [xz + wy, yz - wx, one - (xx + yy)]]
}

#[inline(always)]
pub fn sym_times<L: Lane>(p: &Sym3<L>, v: Vec3<L>) -> Vec3<L> {
    [dot([p[0], p[1], p[2]], v), dot([p[1], p[3], p[4]], v), dot([p[2], p[4], p[5]], v)]
}

/// `A P Aᵀ` of rows `A`.
#[inline(always)]
pub fn congruence<L: Lane>(rows: &[Vec3<L>; 3], p: &Sym3<L>) -> Sym3<L> {
    let [a, b, c] = *rows;
    let (pa, pb, pc) = (sym_times(p, a), sym_times(p, b), sym_times(p, c));
    [dot(a, pa), dot(a, pb), dot(a, pc), dot(b, pb), dot(b, pc), dot(c, pc)]
}

#[inline(always)]
pub fn add_diagonal<L: Lane>(p: &Sym3<L>, s: L) -> Sym3<L> {
    [p[0] + s, p[1], p[2], p[3] + s, p[4], p[5] + s]
}

#[inline(always)]
pub fn trace<L: Lane>(p: &Sym3<L>) -> L {
    p[0] + p[3] + p[5]
}
