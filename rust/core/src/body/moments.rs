//! From samples to moments ten times a second, and what lies between them.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Vector3};

use super::{
    model::Noise,
    preintegration::{Preintegrated, Step},
};
use crate::{Xyz, condition::BREAK_STEPS};

/// What a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// The value at its time stamp.
    Instant,
    /// The mean from its time stamp to the next.
    Interval,
}

/// All sensors' samples on one time base.
#[derive(Clone, Debug)]
pub struct Readings<'a> {
    /// Strictly increasing, s.
    pub time_s: &'a [f64],
    /// Of each sensor, rad/s.
    pub gyr: Vec<&'a [Xyz]>,
    /// Of each sensor, m/s².
    pub acc: Vec<&'a [Xyz]>,
    /// Nominal step, s.
    pub step_s: f64,
    /// What a sample is.
    pub sampling: Sampling,
}

/// How moments are made of samples.
#[derive(Clone, Copy, Debug)]
pub struct Spacing {
    /// Samples from one moment to the next.
    pub key_samples: usize,
    /// Angular rates at a moment are means over so many samples to either side.
    pub rate_samples: usize,
    /// The longest gap that is bridged by the cubic through the samples around it, s.
    pub bridge_s: f64,
}

/// One moment.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Its sample.
    pub sample: usize,
    /// s.
    pub time_s: f64,
    /// From here to the next moment, s.
    pub span_s: f64,
    /// Whether samples lead from here to the next moment.
    pub linked: bool,
}

/// What one sensor says between two moments, and how to make its residual white.
#[derive(Clone, Debug)]
pub struct Link {
    /// The increments.
    pub pre: Preintegrated,
    /// See [`Preintegrated::whitening`].
    pub whitening: [[f64; 9]; 9],
}

/// Everything the samples say.
#[derive(Clone, Debug)]
pub struct Moments {
    /// In the order of time.
    pub moments: Vec<Moment>,
    /// Of every sensor at every moment, moment by moment; None where no samples lead to the next moment.
    pub links: Vec<Option<Link>>,
    /// Angular rate that each sensor reads at each moment, rad/s, likewise.
    pub rates: Vec<Vector3<f64>>,
    /// Variance of one channel of each of them that no smooth motion explains, (rad/s)²: impacts and ringing straps that samples
    /// catch at random. Their mean over the recording would hide when they come.
    pub rate_variances: Vec<f64>,
    /// Number of sensors.
    pub sensors: usize,
    /// Biases of each sensor beforehand: gyroscope, accelerometer. Increments are made with them.
    pub biases: Vec<[Vector3<f64>; 2]>,
}

fn vector(row: &Xyz) -> Vector3<f64> {
    Vector3::from(*row)
}

impl Moments {
    /// Makes them; `biases` (gyroscope, accelerometer) of each sensor are what is known of them beforehand, around which
    /// increments are corrected to first order: over a tenth of a second that is exact to 1e-6 for any bias that a sensor has. None where the noise leaves a
    /// direction of the increments without any.
    pub fn new(readings: &Readings<'_>, spacing: &Spacing, biases: &[[Vector3<f64>; 2]], noise: &Noise) -> Option<Self> {
        let (moments, stretches) = place(readings, spacing);
        let sensors = readings.gyr.len();
        let roughness: Vec<[f64; 2]> =
            (0..sensors).map(|s| [slope_rms(readings, readings.gyr[s]), slope_rms(readings, readings.acc[s])]).collect();
        let mut links = Vec::with_capacity(moments.len() * sensors);
        let mut rates = Vec::with_capacity(moments.len() * sensors);
        let mut rate_variances = Vec::with_capacity(moments.len() * sensors);
        for (moment, stretch) in moments.iter().zip(&stretches) {
            for s in 0..sensors {
                let (mean, count) = rate(readings, s, moment.sample, *stretch, spacing.rate_samples);
                rates.push(mean);
                rate_variances.push(match readings.sampling {
                    Sampling::Instant => {
                        let (from, to) =
                            (moment.sample.saturating_sub(spacing.key_samples), moment.sample + spacing.key_samples);
                        scatter(readings, readings.gyr[s], from, to, *stretch) / count as f64
                    }
                    Sampling::Interval => 0.0,
                });
                links.push(if moment.linked {
                    let pre = integrate(readings, s, moment.sample, *stretch, spacing, &biases[s], noise, roughness[s]);
                    let whitening = pre.whitening()?;
                    Some(Link { pre, whitening })
                } else {
                    None
                });
            }
        }
        Some(Self { moments, links, rates, rate_variances, sensors, biases: biases.to_vec() })
    }

    /// Number of moments.
    pub fn len(&self) -> usize {
        self.moments.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.moments.is_empty()
    }

    /// Whether a stretch begins here.
    pub fn begins(&self, k: usize) -> bool {
        k == 0 || !self.moments[k - 1].linked
    }
}

/// Moments every `key_samples` samples from the beginning of each stretch, with the stretch that each lies in.
fn place(readings: &Readings<'_>, spacing: &Spacing) -> (Vec<Moment>, Vec<(usize, usize)>) {
    let time = readings.time_s;
    let longest = spacing.bridge_s.max(BREAK_STEPS * readings.step_s);
    let (mut moments, mut stretches) = (Vec::new(), Vec::new());
    let mut start = 0;
    for end in 1..=time.len() {
        if end < time.len() && time[end] - time[end - 1] <= longest {
            continue;
        }
        let mut at = start;
        while at < end {
            let linked = at + spacing.key_samples < end;
            moments.push(Moment { sample: at, time_s: time[at], span_s: 0.0, linked });
            stretches.push((start, end));
            at += spacing.key_samples;
        }
        start = end;
    }
    for k in 1..moments.len() {
        moments[k - 1].span_s = moments[k].time_s - moments[k - 1].time_s;
    }
    (moments, stretches)
}

/// Root mean square of the slope of a signal, 1/s, over ordinary steps.
fn slope_rms(readings: &Readings<'_>, rows: &[Xyz]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for (pair, t) in rows.windows(2).zip(readings.time_s.windows(2)) {
        let dt = t[1] - t[0];
        if dt <= 1.5 * readings.step_s {
            sum += (vector(&pair[1]) - vector(&pair[0])).norm_squared() / (3.0 * dt * dt);
            count += 1;
        }
    }
    ComplexField::sqrt(sum / f64::from(count.max(1)))
}

/// Variance that no smooth motion explains, of one channel of one sample: sixth differences over the steps between two samples,
/// third ones where gaps leave no room for these, as far as the stretch goes. Impacts and ringing straps are faster than samples
/// follow: what lies between these is then known no better than they scatter.
fn scatter(readings: &Readings<'_>, rows: &[Xyz], from: usize, to: usize, stretch: (usize, usize)) -> f64 {
    let sixth = differences(readings, rows, (from, to), stretch, &[1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0]);
    sixth.or_else(|| differences(readings, rows, (from, to), stretch, &[1.0, -3.0, 3.0, -1.0])).unwrap_or(0.0)
}

/// Mean square of differences over ordinary steps, of one channel, over that of white noise of variance 1; None where there are
/// not so many ordinary steps in a row.
fn differences(
    readings: &Readings<'_>,
    rows: &[Xyz],
    (from, to): (usize, usize),
    stretch: (usize, usize),
    weights: &[f64],
) -> Option<f64> {
    let (steps, reach) = (weights.len() - 1, weights.len() / 2);
    let (low, high) = ((from + 1).saturating_sub(reach).max(stretch.0), (to + reach).min(stretch.1));
    let white: f64 = weights.iter().map(|w| w * w).sum();
    let (mut sum, mut count) = (0.0, 0_u32);
    for (some, t) in rows[low..high].windows(weights.len()).zip(readings.time_s[low..high].windows(weights.len())) {
        if t[steps] - t[0] < (steps as f64 + 0.5) * readings.step_s {
            let difference: Vector3<f64> = some.iter().zip(weights).map(|(row, weight)| vector(row) * *weight).sum();
            sum += difference.norm_squared() / (3.0 * white);
            count += 1;
        }
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// What the four samples around the step from one to the next weigh in the mean over it of the cubic through them; None where
/// the stretch has no four.
fn cubic(readings: &Readings<'_>, n: usize, stretch: (usize, usize)) -> Option<[f64; 4]> {
    if n <= stretch.0 || n + 2 >= stretch.1 {
        return None;
    }
    let t = &readings.time_s[n - 1..n + 3];
    let (before, dt, after) = (t[1] - t[0], t[2] - t[1], t[3] - t[2]);
    let whole = 12.0 * (before + dt + after);
    let first = -dt * dt * (dt + 2.0 * after) / (whole * before * (before + dt));
    let last = -dt * dt * (dt + 2.0 * before) / (whole * after * (after + dt));
    // What is constant or straight stays what it is.
    let third = 0.5 + (before * first - (dt + after) * last) / dt;
    Some([first, 1.0 - first - third - last, third, last])
}

/// Mean rate around a sample, within its stretch and not across a gap, and of how many samples.
fn rate(readings: &Readings<'_>, sensor: usize, sample: usize, stretch: (usize, usize), reach: usize) -> (Vector3<f64>, usize) {
    let rows = readings.gyr[sensor];
    let (low, high) = match readings.sampling {
        Sampling::Instant => {
            let most = reach.min(sample - stretch.0).min(stretch.1 - 1 - sample);
            let lasts_s = |reach: usize| readings.time_s[sample + reach] - readings.time_s[sample - reach];
            let reach = (0..=most).rev().find(|n| lasts_s(*n) < (2.0 * *n as f64 + 0.5) * readings.step_s).unwrap_or(0);
            (sample - reach, sample + reach + 1)
        }
        // The sample before ends where this one begins.
        Sampling::Interval => {
            let reach = reach.max(1).min(sample - stretch.0).min(stretch.1 - sample);
            (sample - reach, sample + reach.max(1))
        }
    };
    (rows[low..high].iter().map(vector).sum::<Vector3<f64>>() / (high - low) as f64, high - low)
}

#[expect(clippy::too_many_arguments, reason = "one call from one place")]
fn integrate(
    readings: &Readings<'_>,
    sensor: usize,
    from: usize,
    stretch: (usize, usize),
    spacing: &Spacing,
    bias: &[Vector3<f64>; 2],
    noise: &Noise,
    roughness: [f64; 2],
) -> Preintegrated {
    let mut pre = Preintegrated::new(bias[0], bias[1]);
    let (gyr, acc) = (readings.gyr[sensor], readings.acc[sensor]);
    let to = from + spacing.key_samples;
    // A mean over the interval is exact however rough the motion.
    let [rough_gyr, rough_acc] = [gyr, acc].map(|rows| match readings.sampling {
        Sampling::Instant => scatter(readings, rows, from, to, stretch),
        Sampling::Interval => 0.0,
    });
    for n in from..to {
        let dt = readings.time_s[n + 1] - readings.time_s[n];
        let weights = cubic(readings, n, stretch);
        let mean = |rows: &[Xyz]| match (readings.sampling, weights) {
            (Sampling::Instant, Some(w)) => rows[n - 1..n + 3].iter().zip(w).map(|(row, weight)| vector(row) * weight).sum(),
            (Sampling::Instant, None) => 0.5 * (vector(&rows[n]) + vector(&rows[n + 1])),
            (Sampling::Interval, _) => vector(&rows[n]),
        };
        // Of what happens in a gap neither cubic nor straight line knows more than to within slope·dt/8 on average, in each
        // channel: so it is in walking, where a gap of 0.05 to 0.3 s was cut, and less in slower motion.
        let missed = |rough: f64| {
            let miss = if dt > 1.5 * readings.step_s { rough * dt * dt / 8.0 } else { 0.0 };
            miss * miss / dt
        };
        let wider = |std: f64, scatter: f64, rough: f64| ComplexField::sqrt((std * std).max(scatter * dt) + missed(rough));
        let mut step = Step { dt, gyr: mean(gyr), acc: mean(acc) };
        if readings.sampling == Sampling::Instant {
            // The axis turns within the step, and the force with it: coning and sculling (Savage 1998) of linear rate and force.
            let [r0, r1, f0, f1] = [gyr[n], gyr[n + 1], acc[n], acc[n + 1]].map(Vector3::from);
            step.gyr += r0.cross(&r1) * (dt / 12.0);
            step.acc += (r0.cross(&f1) + f0.cross(&r1)) * (dt / 12.0);
        }
        let (gyr_std, acc_std) = (wider(noise.gyr, rough_gyr, roughness[0]), wider(noise.acc, rough_acc, roughness[1]));
        pre.push(&step, gyr_std, acc_std, noise.position);
    }
    pre
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    fn readings<'a>(time_s: &'a [f64], rows: &'a [Xyz]) -> Readings<'a> {
        Readings { time_s, gyr: vec![rows], acc: vec![rows], step_s: 0.01, sampling: Sampling::Instant }
    }

    #[test]
    fn smooth_motion_does_not_scatter_and_noise_does_by_its_variance() {
        let mut time_s: Vec<f64> = (0..4000).map(|n| 0.01 * f64::from(n)).collect();
        let curve: Vec<Xyz> = time_s.iter().map(|t| [1.0 + t, 2.0 * t * t, 3.0 - t * t]).collect();
        assert!(scatter(&readings(&time_s, &curve), &curve, 0, 3999, (0, 4000)) < 1e-12);
        let mut state = 1_u64;
        let noise: Vec<Xyz> = (0..4000)
            .map(|_| {
                [(); 3].map(|()| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
                })
            })
            .collect();
        let found = scatter(&readings(&time_s, &noise), &noise, 0, 3999, (0, 4000));
        assert!((found * 12.0 - 1.0).abs() < 0.05, "{found}");
        // What lies beyond the stretch does not count, and neither do differences across a gap.
        let mut step = curve;
        step.iter_mut().skip(2000).for_each(|row| row[0] += 50.0);
        time_s.iter_mut().skip(2000).for_each(|t| *t += 1.0);
        assert!(scatter(&readings(&time_s, &step), &step, 0, 3999, (0, 4000)) < 1e-12);
        assert!(scatter(&readings(&time_s, &step), &step, 0, 1990, (0, 2000)) < 1e-12);
        assert_eq!(scatter(&readings(&time_s, &step), &step, 0, 1, (0, 2)), 0.0);
    }

    #[test]
    fn a_cubic_is_integrated_exactly_however_its_samples_lie() {
        let time_s = [0.0, 0.013, 0.1, 0.11, 0.16, 0.4];
        let curve = |t: f64| [1.0 - 2.0 * t + 3.0 * t * t - 40.0 * t * t * t, t, t * t];
        let integral = |t: f64| t - t * t + t * t * t - 10.0 * t * t * t * t;
        let rows: Vec<Xyz> = time_s.iter().map(|t| curve(*t)).collect();
        let readings = readings(&time_s, &rows);
        for n in 1..4 {
            let found: f64 = cubic(&readings, n, (0, 6)).into_iter().flatten().zip(n - 1..).map(|(w, k)| w * rows[k][0]).sum();
            let expected = (integral(time_s[n + 1]) - integral(time_s[n])) / (time_s[n + 1] - time_s[n]);
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        // Nothing reaches out of a stretch.
        assert!(cubic(&readings, 0, (0, 6)).is_none() && cubic(&readings, 4, (0, 6)).is_none());
        assert!(cubic(&readings, 2, (2, 6)).is_none() && cubic(&readings, 2, (0, 4)).is_none());
    }

    #[test]
    fn a_gap_costs_no_less_than_what_is_missed_in_it() {
        // A leg that swings once and a half a second, from 100 samples a second of which eight in a row are lost somewhere.
        let swing = |t: f64| [4.0 * ComplexField::sin(9.0 * t), 3.0 * ComplexField::cos(9.0 * t), ComplexField::sin(18.0 * t)];
        let whole: Vec<f64> = (0..1000).map(|n| 0.01 * f64::from(n)).collect();
        let (mut squares, mut count) = (0.0, 0);
        for lost in (100..900).step_by(7) {
            let time_s: Vec<f64> = whole[..lost].iter().chain(&whole[lost + 8..]).copied().collect();
            let rows: Vec<Xyz> = time_s.iter().map(|t| swing(*t)).collect();
            let readings = readings(&time_s, &rows);
            let weights = cubic(&readings, lost - 1, (0, rows.len())).into_iter().flatten();
            let found: Vector3<f64> = weights.zip(&rows[lost - 2..]).map(|(w, row)| vector(row) * w).sum();
            let exact: Vector3<f64> =
                (0..900).map(|k| Vector3::from(swing(time_s[lost - 1] + 1e-4 * (f64::from(k) + 0.5)))).sum::<Vector3<f64>>()
                    / 900.0;
            // What `integrate` takes for its spread.
            let stated = slope_rms(&readings, &rows) * 0.09 / 8.0;
            squares += (found - exact).norm_squared() / (3.0 * stated * stated);
            count += 1;
        }
        assert!(squares / f64::from(count) < 1.0, "{}", squares / f64::from(count));
    }

    #[test]
    fn few_samples_give_the_motion_between_them() {
        // A leg that swings and twists, twice a second, by 25 samples a second and by 2000.
        let swing = |t: f64| {
            let (s, c) = (ComplexField::sin(12.0 * t), ComplexField::cos(12.0 * t));
            [[4.0 * s, 3.0 * c, 1.0 + s * c], [2.0 * c, 9.8 + 5.0 * s, 4.0 * c]]
        };
        let made = |rate: u32, samples: usize, from: usize| {
            let time_s: Vec<f64> = (0..).take(from + samples + 4).map(|n: u32| f64::from(n) / f64::from(rate)).collect();
            let rows: Vec<[Xyz; 2]> = time_s.iter().map(|t| swing(*t)).collect();
            let (turns, forces): (Vec<Xyz>, Vec<Xyz>) = rows.iter().map(|[g, a]| (*g, *a)).unzip();
            let step_s = 1.0 / f64::from(rate);
            let readings =
                Readings { time_s: &time_s, gyr: vec![&turns], acc: vec![&forces], step_s, sampling: Sampling::Instant };
            let spacing = Spacing { key_samples: samples, rate_samples: 0, bridge_s: 0.3 };
            let [gyr_walk, acc_walk, rate, gyr_bias, acc_bias, center, gauge] = [1e-3; 7];
            let [gyr, acc, position, tail] = [1e-3, 1e-3, 1e-4, 5.0];
            let noise = Noise { gyr, acc, position, gyr_walk, acc_walk, rate, gyr_bias, acc_bias, center, gauge, tail };
            integrate(&readings, 0, from, (0, time_s.len()), &spacing, &[Vector3::zeros(); 2], &noise, [0.0; 2])
        };
        let (few, many) = (made(25, 5, 5), made(2000, 400, 400));
        // Trapezoids alone are off by 0.017 and 0.005 m/s.
        let off = few.turn.tr_mul(&many.turn) - nalgebra::Matrix3::identity();
        assert!(off.norm() < 2e-3, "{}", off.norm());
        let off = few.velocity - many.velocity;
        assert!(off.norm() < 2e-3, "{}", off.norm());
    }
}
