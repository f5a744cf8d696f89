//! How light scatters below a surface: measured coefficients, and the dipole that follows from them.

use std::f64::consts::PI;

use crate::error::{Error, check_setting};

/// A coefficient of a channel may be up to this, and what extinguishes light less than one over it scatters none.
const DENSEST: f64 = 1e12;

/// What a homogeneous material does to the light within it: coefficients of red, green and blue, one over a world unit.
///
/// Those named here are of table 1 of Jensen, Marschner, Levoy and Hanrahan, *A Practical Model for Subsurface Light Transport*
/// (2001), in 1/mm; [`Scattering::scaled`] takes them to the units of a world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scattering {
    /// Absorption `σ_a`, 0 to 1e12 per world unit. 0 loses no light within.
    pub sigma_a: [f32; 3],
    /// Reduced scattering `σ_s' = σ_s (1 − g)`, with the mean cosine g of a scattering event; 0 to 1e12 per world unit. Where
    /// it is 0 nothing scatters, and the surface is black.
    pub sigma_s_prime: [f32; 3],
    /// Index of refraction over that of the air outside, 1 to 3, where the fit of Fresnel's reflectance holds.
    pub eta: f32,
}

/// One of the table, in 1/mm.
const fn measured(sigma_s_prime: [f32; 3], sigma_a: [f32; 3], eta: f32) -> Scattering {
    Scattering {
        sigma_a,
        sigma_s_prime,
        eta,
    }
}

impl Scattering {
    /// Apple.
    pub const APPLE: Self = measured([2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046], 1.3);
    /// Chicken, the first of two.
    pub const CHICKEN1: Self = measured([0.15, 0.21, 0.38], [0.015, 0.077, 0.19], 1.3);
    /// Chicken, the second.
    pub const CHICKEN2: Self = measured([0.19, 0.25, 0.32], [0.018, 0.088, 0.20], 1.3);
    /// Cream.
    pub const CREAM: Self = measured([7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], 1.3);
    /// Ketchup.
    pub const KETCHUP: Self = measured([0.18, 0.07, 0.03], [0.061, 0.97, 1.45], 1.3);
    /// Marble.
    pub const MARBLE: Self = measured([2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5);
    /// Potato.
    pub const POTATO: Self = measured([0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12], 1.3);
    /// Skimmed milk.
    pub const SKIM_MILK: Self = measured([0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142], 1.3);
    /// Skin, the first of two.
    pub const SKIN1: Self = measured([0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3);
    /// Skin, the second.
    pub const SKIN2: Self = measured([1.09, 1.59, 1.79], [0.013, 0.070, 0.145], 1.3);
    /// Spectralon, which absorbs nothing that could be measured: light spreads without bound.
    pub const SPECTRALON: Self = measured([11.6, 20.4, 14.9], [0.0, 0.0, 0.0], 1.3);
    /// Whole milk.
    pub const WHOLE_MILK: Self = measured([2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], 1.3);

    /// All of the table by the names that it has.
    pub const NAMED: [(&'static str, Self); 12] = [
        ("apple", Self::APPLE),
        ("chicken1", Self::CHICKEN1),
        ("chicken2", Self::CHICKEN2),
        ("cream", Self::CREAM),
        ("ketchup", Self::KETCHUP),
        ("marble", Self::MARBLE),
        ("potato", Self::POTATO),
        ("skimmilk", Self::SKIM_MILK),
        ("skin1", Self::SKIN1),
        ("skin2", Self::SKIN2),
        ("spectralon", Self::SPECTRALON),
        ("wholemilk", Self::WHOLE_MILK),
    ];

    /// One of [`Scattering::NAMED`].
    pub fn by_name(name: &str) -> Option<Self> {
        let mut named = Self::NAMED.iter();
        named.find_map(|(known, scattering)| (*known == name).then_some(*scattering))
    }

    /// The same material in units of which each is so many of those that its coefficients are of: 1000 takes what is measured in
    /// 1/mm to a world of metres. What comes out is checked where it is used.
    #[must_use]
    pub fn scaled(self, units: f32) -> Self {
        Self {
            sigma_a: self.sigma_a.map(|sigma| sigma * units),
            sigma_s_prime: self.sigma_s_prime.map(|sigma| sigma * units),
            ..self
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        for (field, sigmas) in [
            ("Scattering::sigma_a", self.sigma_a),
            ("Scattering::sigma_s_prime", self.sigma_s_prime),
        ] {
            for sigma in sigmas {
                let accept = (0.0..=DENSEST).contains(&f64::from(sigma));
                check_setting(accept, field, sigma, "0 to 1e12")?;
            }
        }
        check_setting(
            (1.0..=3.0).contains(&self.eta),
            "Scattering::eta",
            self.eta,
            "1 to 3",
        )
    }

    /// `F_dr`: the share of diffuse light from within that the boundary sends back, by the fit of Egan and Hilgeman that Jensen
    /// et al. (2001) use, `−1.440 / η² + 0.710 / η + 0.668 + 0.0636 η`.
    pub fn internal_reflectance(&self) -> f64 {
        let eta = f64::from(self.eta);
        (-1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta).clamp(0.0, 1.0)
    }

    /// The share of diffuse light from outside that the boundary lets in, which is `η² (1 − F_dr)`, since as much light is let
    /// through either way at an étendue that is η² times as large within.
    pub fn transmittance(&self) -> f64 {
        let eta = f64::from(self.eta);
        (eta * eta * (1.0 - self.internal_reflectance())).min(1.0)
    }

    /// The dipoles of red, green and blue.
    pub fn dipoles(&self) -> [Dipole; 3] {
        let internal = self.internal_reflectance();
        // As much as the boundary reflects, so much farther outside is it as if there were no light.
        let boundary = (1.0 + internal) / (1.0 - internal);
        [0, 1, 2].map(|channel| {
            let absorbed = f64::from(self.sigma_a[channel]);
            let scattered = f64::from(self.sigma_s_prime[channel]);
            let extinction = absorbed + scattered;
            if extinction * DENSEST < 1.0 {
                return Dipole::default();
            }
            let z_r = 1.0 / extinction;
            let diffusion = z_r / 3.0;
            Dipole {
                albedo: scattered / extinction,
                sigma_tr: (3.0 * absorbed * extinction).sqrt(),
                z_r,
                z_v: z_r + 4.0 * boundary * diffusion,
            }
        })
    }

    /// The distance beyond which of no channel more than a share, 0 to 1, of what comes out does, world units.
    pub fn reach(&self, share: f64) -> f64 {
        let reaches = self.dipoles().map(|dipole| dipole.reach(share));
        reaches.into_iter().fold(0.0, f64::max)
    }

    /// The shortest mean free path `1 / σ_t'` of the channels that scatter, world units; infinite where none does.
    pub fn mean_free_path(&self) -> f64 {
        let scattering = self.dipoles().into_iter().filter(|d| d.albedo > 0.0);
        scattering.map(|d| d.z_r).fold(f64::INFINITY, f64::min)
    }

    /// The share of the light let in that comes out again, of a plane: red, green and blue.
    pub fn diffuse_reflectance(&self) -> [f64; 3] {
        self.dipoles().map(|dipole| dipole.reflectance())
    }
}

/// Light that enters a flat, endless surface at a point comes out around it as if there were a source below the surface and a
/// negative one above it (Jensen et al. 2001, section 3.1, equation 4). Lengths are world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dipole {
    /// `α' = σ_s' / σ_t'`, the share of an extinction that scatters; 0 of what scatters nothing.
    pub albedo: f64,
    /// `σ_tr = √(3 σ_a σ_t')`, which light far from where it entered falls off by, one over a world unit.
    pub sigma_tr: f64,
    /// `z_r = 1 / σ_t'`: how deep below the surface the source lies, one mean free path.
    pub z_r: f64,
    /// `z_v = z_r + 4 A D`: how far above it the negative one lies.
    pub z_v: f64,
}

impl Default for Dipole {
    /// Of what scatters nothing.
    fn default() -> Self {
        Self {
            albedo: 0.0,
            sigma_tr: 0.0,
            z_r: 1.0,
            z_v: 1.0,
        }
    }
}

impl Dipole {
    /// `R_d`: radiant exitance for each unit of flux let in at a distance, world units; one over a world unit squared.
    pub fn profile(&self, distance: f64) -> f64 {
        let of_source = |z: f64| {
            let rho = (distance * distance + z * z).sqrt();
            (z / rho) * (1.0 + self.sigma_tr * rho) * (-self.sigma_tr * rho).exp() / (rho * rho)
        };
        self.albedo / (4.0 * PI) * (of_source(self.z_r) + of_source(self.z_v))
    }

    /// The share of the flux let in at a point that comes out within a distance of it: the integral of the profile over a disk.
    pub fn reflectance_within(&self, distance: f64) -> f64 {
        let of_source = |z: f64| {
            let rho = (distance * distance + z * z).sqrt();
            (-self.sigma_tr * z).exp() - (z / rho) * (-self.sigma_tr * rho).exp()
        };
        0.5 * self.albedo * (of_source(self.z_r) + of_source(self.z_v))
    }

    /// The same at any distance, `α'/2 (e^(−σ_tr z_r) + e^(−σ_tr z_v))`: 1 where nothing is absorbed, 0 where nothing is
    /// scattered.
    pub fn reflectance(&self) -> f64 {
        let of_source = |z: f64| (-self.sigma_tr * z).exp();
        0.5 * self.albedo * (of_source(self.z_r) + of_source(self.z_v))
    }

    /// The distance beyond which no more than a share, 0 to 1, of what comes out does. 0 of what scatters nothing.
    pub fn reach(&self, share: f64) -> f64 {
        let all = self.reflectance();
        let beyond = |distance: f64| all - self.reflectance_within(distance);
        let limit = share.clamp(1e-6, 1.0) * all;
        let (mut near, mut far) = (0.0, self.z_r);
        while beyond(far) > limit && far < 1e30 {
            (near, far) = (far, 2.0 * far);
        }
        for _ in 0..40 {
            let middle = 0.5 * (near + far);
            if beyond(middle) > limit {
                near = middle;
            } else {
                far = middle;
            }
        }
        if all > 0.0 { far } else { 0.0 }
    }
}
