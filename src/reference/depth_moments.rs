//! Mirror of `wgsl/depth_moments.wgsl` and `wgsl/common/moments.wgsl`.

use crate::depth_moments::LEVELS;

/// Moments of view depth over an area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Mean view depth of what has a surface.
    pub mean: f64,
    /// Its variance.
    pub variance: f64,
    /// The share of the area that has a surface.
    pub covered: f64,
    /// The share in the viewport.
    pub inside: f64,
}

/// The moments over several areas that count by shares, whose sum is at most 1.
pub fn merge(areas: &[(Moments, f64)]) -> Moments {
    let sum = |of: &dyn Fn(&Moments) -> f64| areas.iter().map(|(m, share)| share * of(m)).sum();
    let covered: f64 = sum(&|m| m.covered);
    let inside = sum(&|m| m.inside);
    if covered <= 0.0 {
        return Moments {
            inside,
            ..Moments::default()
        };
    }
    let mean = sum(&|m| m.covered * m.mean) / covered;
    let variance = sum(&|m| m.covered * (m.variance + (m.mean - mean) * (m.mean - mean))) / covered;
    Moments {
        mean,
        variance,
        covered,
        inside,
    }
}

/// The levels of a depth buffer's moments, its own pixels first.
#[derive(Clone, Debug)]
pub struct Pyramid {
    levels: Vec<([u32; 2], Vec<Moments>)>,
}

impl Pyramid {
    /// From the view depths of a viewport's pixels, rows from the top; `None` for the sky.
    pub fn new([width, height]: [u32; 2], depths: &[Option<f64>]) -> Self {
        let pixel = |depth: &Option<f64>| Moments {
            mean: depth.unwrap_or(0.0),
            variance: 0.0,
            covered: f64::from(u8::from(depth.is_some())),
            inside: 1.0,
        };
        let mut pyramid = Self {
            levels: vec![([width, height], depths.iter().map(pixel).collect())],
        };
        for level in 0..LEVELS {
            let size = pyramid.levels[level as usize].0.map(|n| n.div_ceil(2));
            let halved = (0..size[0] * size[1])
                .map(|i| {
                    let corner = [2 * (i % size[0]), 2 * (i / size[0])].map(i64::from);
                    let fine = |x, y| (pyramid.at([corner[0] + x, corner[1] + y], level), 0.25);
                    merge(&[fine(0, 0), fine(1, 0), fine(0, 1), fine(1, 1)])
                })
                .collect();
            pyramid.levels.push((size, halved));
        }
        pyramid
    }

    /// Those of a texel; nothing beyond the edges.
    pub fn at(&self, [x, y]: [i64; 2], level: u32) -> Moments {
        let ([width, height], texels) = &self.levels[level as usize];
        let inside = (0..i64::from(*width)).contains(&x) && (0..i64::from(*height)).contains(&y);
        if inside {
            texels[(y * i64::from(*width) + x) as usize]
        } else {
            Moments::default()
        }
    }

    /// Between the four squares about a place.
    fn blended(&self, place: [f64; 2], level: u32) -> Moments {
        let p = place.map(|c| c / f64::from(1_u32 << level) - 0.5);
        let corner = p.map(f64::floor);
        let f = [p[0] - corner[0], p[1] - corner[1]];
        let texel = corner.map(|c| c as i64);
        let square = |x: i64, y: i64| {
            let share = |k: i64, f: f64| if k == 0 { 1.0 - f } else { f };
            let moments = self.at([texel[0] + x, texel[1] + y], level);
            (moments, share(x, f[0]) * share(y, f[1]))
        };
        merge(&[square(0, 0), square(1, 0), square(0, 1), square(1, 1)])
    }

    /// Of a square of 2^level pixels a side about a place.
    pub fn around(&self, place: [f64; 2], level: f64) -> Moments {
        let clamped = level.clamp(0.0, f64::from(LEVELS));
        let lower = clamped.floor() as u32;
        let between = clamped - f64::from(lower);
        merge(&[
            (self.blended(place, lower), 1.0 - between),
            (self.blended(place, (lower + 1).min(LEVELS)), between),
        ])
    }
}
