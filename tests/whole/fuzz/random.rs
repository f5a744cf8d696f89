//! Seeded choices: settings within their ranges and at their ends and, in cases that are wild, now and then beyond.

use deep_screen_space::glam::DVec3;

/// What a caller's arithmetic can end in.
const ODD: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-45,
    -1e-45,
    0.0,
    -0.0,
    -1.0,
    1e30,
];

/// The generator of a case (Steele, Lea and Flood, *Fast Splittable Pseudorandom Number Generators*, 2014).
pub struct Random {
    state: u64,
    wild: bool,
}

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self {
            state: seed,
            wild: false,
        };
        random.wild = random.chance(0.4);
        random
    }

    /// Whether anything may be out of its range. Where nothing is every call has to be accepted.
    pub fn is_wild(&self) -> bool {
        self.wild
    }

    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// 0…1, without 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// 0…`end`, without it.
    pub fn below(&mut self, end: u32) -> u32 {
        (self.unit() * f64::from(end)) as u32
    }

    pub fn one_of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len() as u32) as usize].clone()
    }

    /// Whether to give what should be refused here.
    pub fn breaks(&mut self) -> bool {
        self.wild && self.chance(0.02)
    }

    /// A setting of a range whose ends are accepted.
    pub fn setting(&mut self, low: f32, high: f32) -> f32 {
        if self.breaks() {
            let odd = self.odd();
            return self.one_of(&[
                odd,
                low - low.abs().max(1.0) * 1e-3,
                high + high.abs() * 1e-3,
            ]);
        }
        match self.below(10) {
            0 => low,
            1 => high,
            _ => {
                let [low, high] = [low.clamp(-1e6, 1e6), high.clamp(-1e6, 1e6)];
                self.between(low.into(), high.into()) as f32
            }
        }
    }

    /// Of a range that begins above 0, or ends at infinity.
    pub fn scale(&mut self, low: f32, high: f32) -> f32 {
        if self.breaks() || self.chance(0.1) {
            return self.setting(low, high);
        }
        let [low, high] = [low, high].map(|end| f64::from(end).clamp(1e-4, 1e4).ln());
        (self.between(low, high).exp() as f32).clamp(low as f32, f32::MAX)
    }

    /// A number of things, mostly few of them.
    pub fn count(&mut self, low: u32, high: u32) -> u32 {
        if self.breaks() {
            return self.one_of(&[
                0,
                low.wrapping_sub(1),
                high.saturating_add(1),
                u32::MAX,
                1 << 31,
                1 << 30,
            ]);
        }
        match self.below(12) {
            0 => low,
            // Rare, since the most takes the longest.
            1 if high < 100 || self.chance(0.05) => high,
            _ => {
                let range = f64::from(high - low) + 1.0;
                let most = if self.chance(0.9) {
                    range.min(64.0)
                } else {
                    range
                };
                low + (most.powf(self.unit()) - 1.0) as u32
            }
        }
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn point(&mut self, extent: f64) -> DVec3 {
        DVec3::new(
            self.between(-extent, extent),
            self.between(-extent, extent),
            self.between(-extent, extent),
        )
    }

    pub fn direction(&mut self) -> DVec3 {
        self.point(1.0).try_normalize().unwrap_or(DVec3::Y)
    }

    pub fn odd(&mut self) -> f32 {
        self.one_of(&ODD)
    }

    /// What buffers and textures hold where nobody wrote them.
    pub fn garbage(&mut self, bytes: usize) -> Vec<u8> {
        (0..bytes.div_ceil(8))
            .flat_map(|_| self.bits().to_le_bytes())
            .take(bytes)
            .collect()
    }
}
