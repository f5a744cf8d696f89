//! What the panel has of each of the crate's structs of settings.

use std::f32::consts::PI;

use deep_screen_space::{
    BounceSettings, BouncedSettings, Combine, Error, HitResolverSettings, ObscuranceSettings,
    Payload, RayBudgetSettings, RaySettings, ReconstructorSettings, ScreenSpaceGiSettings,
    SecondRadius, SgHullSettings, SgHullSize, SoftShadowsSettings, SplatSettings,
    SurfelizerSettings, TemporalSettings,
};

use crate::fields::{Field, Kind, Settings, endless, even, ratios};

/// A struct whose rest is its default, and its table.
macro_rules! settings {
    ($type:ident, $rest:expr, $text:literal, [$($name:literal, $unit:literal, $kind:expr, $help:literal;)*]) => {
        impl Settings for $type {
            const TYPE: &'static str = stringify!($type);
            const REST: &'static str = $text;
            const FIELDS: &'static [Field<Self>] = &[
                $(Field { name: $name, unit: $unit, help: $help, kind: $kind },)*
            ];

            fn rest() -> Self {
                $rest
            }

            fn check(&self) -> Result<(), Error> {
                self.validate()
            }
        }
    };
}

// The radius and the sky are the effect's, and frames count themselves.
settings!(BouncedSettings, Self::default(), "BouncedSettings::default()", [
    "rays_per_pixel", "rays", Kind::Count(even(0, 64), |s| &mut s.rays_per_pixel),
    "Rays of each pixel. Noise falls with the root of their number, time grows with it.";
]);

// The others have tables of their own.
settings!(RaySettings, Self::new(16, Payload::LitRadiance), "RaySettings::new(16, Payload::LitRadiance)", [
    "emitter_samples", "rays", Kind::Count(even(0, 16), |s| &mut s.emitter_samples),
    "Rays of each pixel to surfaces that shine of themselves, beside the others.";
]);

settings!(RayBudgetSettings, Self::default(), "RayBudgetSettings::default()", [
    "rays_per_pixel", "rays", Kind::Number(even(0.0, 64.0), |s| &mut s.rays_per_pixel),
    "Further rays per pixel on average, which go where noise is greatest.";
    "most", "rays", Kind::Count(even(0, 255), |s| &mut s.most),
    "The most rays of one pixel, all sets.";
]);

settings!(HitResolverSettings, Self::default(), "HitResolverSettings::default()", [
    "radius", "pixels", Kind::Count(even(0, 16), |s| &mut s.radius),
    "Half width of the window that shares hits; 0 for each pixel's own alone.";
    "spread", "pixels", Kind::Number(endless(0.25, 16.0), |s| &mut s.spread),
    "Deviation of the Gaussian that neighbours count by.";
    "hit_distances", "distances of hits", Kind::Number(endless(0.05, 10.0), |s| &mut s.hit_distances),
    "How far away a neighbour counts 1/e; smaller keeps contacts sharper and noisier.";
    "damping", "", Kind::Number(endless(0.01, 10.0), |s| &mut s.damping),
    "How far slopes are mistrusted; infinity takes the window's mean.";
    "plane_distance", "pixels", Kind::Number(ratios(0.1, 20.0), |s| &mut s.plane_distance),
    "How far off a pixel's plane a neighbour may lie.";
    "normal_power", "", Kind::Number(ratios(8.0, 1000.0), |s| &mut s.normal_power),
    "Exponent of the cosine between normals; larger keeps creases sharper.";
    "variance_clamp", "deviations", Kind::Number(even(0.0, 20.0), |s| &mut s.variance_clamp),
    "How far neighbours' means may differ; 0 for no such test.";
    "narrowing", "", Kind::Number(even(0.0, 1.0), |s| &mut s.narrowing),
    "How the window narrows over frames that are joined.";
    "frames", "frames", Kind::Number(ratios(1.0, 1000.0), |s| &mut s.frames),
    "How many frames radius and spread suit.";
    "f0", "reflectance", Kind::Color(even(0.0, 1.0), |s| &mut s.f0),
    "Of glossy surfaces seen straight on.";
]);

settings!(TemporalSettings, Self::default(), "TemporalSettings::default()", [
    "max_frames", "frames", Kind::Count(ratios(1, 1024), |s| &mut s.max_frames),
    "How many frames the mean is over.";
    "depth_tolerance", "of the distance", Kind::Number(even(0.0, 0.2), |s| &mut s.depth_tolerance),
    "How far off the history's distance may be.";
    "normal_tolerance", "cosine", Kind::Number(even(-1.0, 1.0), |s| &mut s.normal_tolerance),
    "Least cosine between the pixel's normal and the history's.";
    "clamping", "", Kind::Number(even(0.0, 4.0), |s| &mut s.clamping),
    "How strongly the history is held to this frame's picture; costs bias.";
]);

// The sky is the effect's.
settings!(BounceSettings, Self::in_frame(2), "BounceSettings::in_frame(2)", [
    "radius_pixels", "pixels", Kind::Number(ratios(0.5, 64.0), |s| &mut s.radius_pixels),
    "Of surfels: how finely further bounces are known.";
    "samples", "points", Kind::Count(ratios(1, 16), |s| &mut s.samples),
    "Points of a surfel at which lights are looked up: 1, 2, 4, 8 or 16.";
    "gatherer.rays_per_surfel", "rays", Kind::Count(even(1, 64), |s| &mut s.gatherer.rays_per_surfel),
    "Rays from each side of a surfel.";
    "gatherer.emitter_samples", "rays", Kind::Count(even(0, 16), |s| &mut s.gatherer.emitter_samples),
    "Rays from each side to surfaces that shine of themselves, beside those.";
    "gatherer.backs", "", Kind::Flag(|s| &mut s.gatherer.backs),
    "Whether backs gather too; nothing sees those of closed bodies.";
    "gatherer.most_albedo", "", Kind::Number(even(0.0, 1.0), |s| &mut s.gatherer.most_albedo),
    "The most that surfaces reflect in further bounces.";
    "gatherer.frame", "", Kind::Count(even(0, 64), |s| &mut s.gatherer.frame),
    "Which set of directions rays from surfels take.";
]);

settings!(SurfelizerSettings, Self::default(), "SurfelizerSettings::default()", [
    "radius_pixels", "pixels", Kind::Number(ratios(0.5, 16.0), |s| &mut s.radius_pixels),
    "Radius of a surfel; surfels grow with its inverse square.";
    "density", "surfels a target area", Kind::Number(endless(0.1, 64.0), |s| &mut s.density),
    "How many triangles smaller than a surfel are kept.";
]);

// The radius is the effect's.
settings!(SplatSettings, Self::default(), "SplatSettings::default()", [
    "levels", "levels", Kind::Count(even(1, 8), |s| &mut s.levels),
    "Interleaved levels; each doubles the reach for about the price of the one before.";
    "epsilon", "contribution", Kind::Number(ratios(0.001, 1.0), |s| &mut s.epsilon),
    "At which a surfel moves on to the next level; smaller is slower and less noisy.";
    "unbounded", "", Kind::Flag(|s| &mut s.unbounded),
    "Whether the last level reaches without end.";
    "seed", "", Kind::Count(even(0, 64), |s| &mut s.seed),
    "Which permutation deals pixels to the levels.";
]);

settings!(ReconstructorSettings, Self::default(), "ReconstructorSettings::default()", [
    "radius", "2^level pixels", Kind::Number(even(0.0, 8.0), |s| &mut s.radius),
    "Half width of the smoothing.";
    "plane_distance", "half widths", Kind::Number(ratios(0.01, 4.0), |s| &mut s.plane_distance),
    "How far off a pixel's plane a neighbour may lie.";
    "normal_power", "", Kind::Number(ratios(8.0, 1000.0), |s| &mut s.normal_power),
    "Exponent of the cosine between normals.";
]);

settings!(ObscuranceSettings, Self::default(), "ObscuranceSettings::default()", [
    "radius", "world units", Kind::Number(endless(0.01, 100.0), |s| &mut s.radius),
    "Of the sphere about a pixel's point.";
    "max_pixels", "pixels", Kind::Number(ratios(1.0, 1024.0), |s| &mut s.max_pixels),
    "The largest radius on screen.";
    "thickness", "world units", Kind::Number(endless(0.01, 100.0), |s| &mut s.thickness),
    "How thick surfaces are along the line of sight.";
    "box_half_width", "deviations", Kind::Number(even(0.1, 4.0), |s| &mut s.box_half_width),
    "Half the width of what stands for an area's depths; areas alone read it.";
    "turn", "", Kind::Flag(|s| &mut s.turn),
    "Whether each pixel turns its samples: bands become noise.";
    "seed", "", Kind::Count(even(0, 64), |s| &mut s.seed),
    "Of the turns.";
]);

impl Settings for SecondRadius {
    const TYPE: &'static str = "SecondRadius";
    const REST: &'static str = "SecondRadius { radius: 0.25, combine: Combine::Product }";
    const FIELDS: &'static [Field<Self>] = &[Field {
        name: "radius",
        unit: "world units",
        help: "Of a second sphere, which costs as much again: a small one for fine features.",
        kind: Kind::Number(endless(0.01, 100.0), |s| &mut s.radius),
    }];

    fn rest() -> Self {
        Self {
            radius: 0.25,
            combine: Combine::Product,
        }
    }

    fn check(&self) -> Result<(), Error> {
        ObscuranceSettings {
            second: Some(*self),
            ..ObscuranceSettings::default()
        }
        .validate()
    }
}

settings!(SoftShadowsSettings, Self::default(), "SoftShadowsSettings::default()", [
    "extent", "world units; of the sun a tangent", Kind::Number(even(0.0, 1.0), |s| &mut s.extent),
    "The light's radius; 0 is hard.";
    "max_penumbra", "world units", Kind::Number(ratios(0.01, 10.0), |s| &mut s.max_penumbra),
    "The widest half width of a penumbra.";
    "blockers", "points", Kind::Count(ratios(1, 256), |s| &mut s.blockers),
    "At how many points blockers are looked for.";
    "samples", "points", Kind::Count(ratios(1, 256), |s| &mut s.samples),
    "At how many points visibility is looked up.";
    "turn", "", Kind::Flag(|s| &mut s.turn),
    "Whether each pixel turns its points: bands become noise.";
]);

settings!(ScreenSpaceGiSettings, Self::default(), "ScreenSpaceGiSettings::default()", [
    "radius", "world units", Kind::Number(ratios(0.01, 100.0), |s| &mut s.radius),
    "How far light is gathered from.";
    "samples", "points", Kind::Count(ratios(1, 1024), |s| &mut s.samples),
    "Points in the hemisphere over a pixel.";
    "turn", "", Kind::Flag(|s| &mut s.turn),
    "Whether each pixel turns its points: bands become noise.";
]);

// A quad's side is one of four.
settings!(SgHullSettings, Self::default(), "SgHullSettings::default()", [
    "error_threshold", "mean irradiances", Kind::Number(endless(0.01, 10.0), |s| &mut s.error_threshold),
    "How far a quad's light may be off before it is split; 0 is the truth.";
    "plane_distance", "widths of the view", Kind::Number(ratios(0.0001, 0.1), |s| &mut s.plane_distance),
    "How far off a neighbour's plane a pixel is still one surface with it.";
    "gap", "widths of the view", Kind::Number(ratios(0.001, 1.0), |s| &mut s.gap),
    "How far behind a neighbour.";
    "normal_angle", "radians", Kind::Number(even(0.0, PI), |s| &mut s.normal_angle),
    "From which angle between normals on neighbours are two surfaces.";
]);

// The rest is the picture's, and room.
settings!(SgHullSize, Self::new(1280, 720), "SgHullSize::new(width, height)", [
    "grid", "texels", Kind::Count(ratios(32, 2048), |s| &mut s.grid),
    "Along the longer side of the grid that is cut into surfaces.";
]);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{Slider, accepted};

    /// Both ends of each slider are what the crate accepts, infinity where it is offered, and something beyond is not.
    fn holds<S: Settings>() {
        assert!(S::rest().check().is_ok(), "{}", S::TYPE);
        for field in S::FIELDS {
            let name = format!("{}::{}", S::TYPE, field.name);
            let mut settings = S::rest();
            let mut works = |set: &dyn Fn(&mut S)| {
                settings = S::rest();
                set(&mut settings);
                settings.check().is_ok()
            };
            match &field.kind {
                Kind::Number(slider, of) => {
                    let Slider {
                        from, to, endless, ..
                    } = *slider;
                    assert!(from < to, "{name}");
                    assert!(
                        works(&|s| *of(s) = from) && works(&|s| *of(s) = to),
                        "{name}"
                    );
                    assert!(!endless || works(&|s| *of(s) = f32::INFINITY), "{name}");
                    assert!(accepted(field).is_some(), "{name} has no range");
                }
                Kind::Count(slider, of) => {
                    let Slider { from, to, .. } = *slider;
                    assert!(
                        works(&|s| *of(s) = from) && works(&|s| *of(s) = to),
                        "{name}"
                    );
                }
                Kind::Flag(of) => {
                    assert!(
                        works(&|s| *of(s) = false) && works(&|s| *of(s) = true),
                        "{name}"
                    );
                }
                Kind::Color(slider, of) => {
                    let Slider { from, to, .. } = *slider;
                    assert!(
                        works(&|s| *of(s) = [from; 3]) && works(&|s| *of(s) = [to; 3]),
                        "{name}"
                    );
                    assert!(accepted(field).is_some(), "{name} has no range");
                }
            }
        }
    }

    #[test]
    fn sliders_end_where_the_crate_accepts_them() {
        holds::<BouncedSettings>();
        holds::<RaySettings>();
        holds::<RayBudgetSettings>();
        holds::<HitResolverSettings>();
        holds::<TemporalSettings>();
        holds::<BounceSettings>();
        holds::<SurfelizerSettings>();
        holds::<SplatSettings>();
        holds::<ReconstructorSettings>();
        holds::<ObscuranceSettings>();
        holds::<SecondRadius>();
        holds::<SoftShadowsSettings>();
        holds::<ScreenSpaceGiSettings>();
        holds::<SgHullSettings>();
        holds::<SgHullSize>();
    }

    #[test]
    fn ranges_are_in_the_words_of_the_crate() {
        let radius = &HitResolverSettings::FIELDS[0];
        assert_eq!(accepted(radius), Some("0 to 16"));
        let frames = &TemporalSettings::FIELDS[0];
        assert_eq!(accepted(frames), Some("1 or more"));
        assert_eq!(accepted(&RaySettings::FIELDS[0]), Some("0 to 16"));
    }
}
