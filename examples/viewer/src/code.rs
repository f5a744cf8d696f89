//! The settings of a side as Rust.

use std::fmt::Write;

use deep_screen_space::{Bounces, ObscuranceSettings, Overlap, Placement, SgHullSettings};

use crate::{
    fields::{color, number, rust, rust_with},
    look::{Effect, Look, Method},
};

/// A few statements that an engine can paste: what it hands to the crate for this picture.
pub fn of(look: &Look) -> String {
    match look.method {
        Method::Rays => rays(look),
        Method::Splats => splats(look),
        Method::Depths => depths(look),
        Method::Hull => hull(look),
    }
}

fn effect(look: &Look) -> String {
    let radius = number(look.radius);
    let sky = color(look.sky_radiance);
    match look.effect {
        Effect::BentNormals => format!("RayTracedEffect::BentNormals {{ radius: {radius} }}"),
        Effect::DirectionalOcclusion => {
            format!("RayTracedEffect::DirectionalOcclusion {{ radius: {radius} }}")
        }
        Effect::IndirectDiffuse => {
            format!("RayTracedEffect::IndirectDiffuse {{ sky_radiance: {sky} }}")
        }
        Effect::IndirectSpecular => {
            format!("RayTracedEffect::IndirectSpecular {{ sky_radiance: {sky} }}")
        }
        _ => format!("RayTracedEffect::AmbientOcclusion {{ radius: {radius} }}"),
    }
}

/// Further lines are one level deeper.
fn deeper(text: &str) -> String {
    text.replace('\n', "\n    ")
}

fn rays(look: &Look) -> String {
    // Writing to a string does not fail.
    let mut text = format!("let effect = {};\n", effect(look));
    let further = look.rays.further.as_ref();
    let further = further.map_or("None".into(), |settings| {
        format!("Some({})", deeper(&rust(settings)))
    });
    let _ = write!(
        text,
        "let rays = RaySettings {{\n    rays_per_pixel: {},\n    further: {further},\n    emitter_samples: {},\n    \
         filter: {},\n}};\n",
        look.rays.rays_per_pixel,
        look.rays.emitter_samples,
        deeper(&rust(&look.rays.filter)),
    );
    let temporal = look.temporal.as_ref();
    let temporal = temporal.map_or("None".into(), |settings| {
        format!("Some({})", deeper(&rust(settings)))
    });
    let bounces = look.further_bounces();
    let mut scene = String::from("RayTracedScene::new(&device)?");
    if let Some(bounces) = &bounces {
        scene = "RayTracedScene::with_bounces(&device, Primitives::Triangles, bounces)?".into();
        let how = match bounces.bounces {
            Bounces::InFrame(count) => format!("Bounces::InFrame({count})"),
            Bounces::OverFrames => "Bounces::OverFrames".into(),
        };
        let gatherer = bounces.gatherer;
        let _ = write!(
            text,
            "let bounces = BounceSettings {{\n    bounces: {how},\n    radius_pixels: {},\n    samples: {},\n    gatherer: \
             SurfelGathererSettings {{\n        rays_per_surfel: {},\n        emitter_samples: {},\n        backs: {},\n        \
             most_albedo: {},\n        sky_radiance: {},\n        frame: {},\n    }},\n}};\n",
            number(bounces.radius_pixels),
            bounces.samples,
            gatherer.rays_per_surfel,
            gatherer.emitter_samples,
            gatherer.backs,
            number(gatherer.most_albedo),
            color(gatherer.sky_radiance),
            gatherer.frame,
        );
    }
    if look.aims() {
        scene.push_str(".with_emitters(&device)?");
    }
    let _ = writeln!(text, "let scene = {scene};");
    let _ = write!(
        text,
        "let descriptor = RayTracedViewDescriptor {{\n    rays,\n    temporal: {temporal},\n    further_bounces: {},\n    \
         ..RayTracedViewDescriptor::new(effect, Quality::Balanced, target)\n}};\n",
        bounces.is_some(),
    );
    text
}

fn splats(look: &Look) -> String {
    let two_sided = look.two_sided;
    let overlap = match look.overlap {
        Overlap::Add => "Overlap::Add",
        Overlap::Independent => "Overlap::Independent",
    };
    let unit = number(look.unit);
    let effect = match look.effect {
        Effect::BentNormals => {
            format!(
                "BentNormals {{\n    two_sided: {two_sided},\n    overlap: {overlap},\n}}\n.effect()"
            )
        }
        Effect::DirectionalOcclusion => format!(
            "DirectionalOcclusion {{\n    two_sided: {two_sided},\n    overlap: {overlap},\n}}\n.effect()"
        ),
        Effect::IndirectDiffuse => format!(
            "DiffuseBounce {{\n    two_sided: {two_sided},\n    unit: {unit},\n}}\n.effect()?"
        ),
        Effect::IndirectSpecular => format!(
            "SpecularBounce {{\n    two_sided: {two_sided},\n    unit: {unit},\n    f0: {},\n}}\n.effect()?",
            color(look.f0)
        ),
        Effect::SubsurfaceScattering => {
            let scattering = look.scattering().scattering;
            let text = |c: [f32; 3]| color(c);
            format!(
                "SubsurfaceScattering {{\n    unit: {unit},\n    ..SubsurfaceScattering::new(Scattering {{\n        sigma_a: {},\n        \
                 sigma_s_prime: {},\n        eta: {},\n    }})\n}}\n.effect()?",
                text(scattering.sigma_a),
                text(scattering.sigma_s_prime),
                number(scattering.eta),
            )
        }
        _ => format!(
            "AmbientOcclusion {{\n    two_sided: {two_sided},\n    overlap: {overlap},\n    ..AmbientOcclusion::default()\n}}\n.effect()"
        ),
    };
    let placement = look.splats.surfelizer.placement;
    let placement: Vec<_> = (placement != Placement::default())
        .then(|| ("placement", format!("Placement::{placement:?}")))
        .into_iter()
        .collect();
    let radius = [("radius", number(look.splats.splat.radius))];
    format!(
        "let effect = {effect};\nlet surfelizer = {};\nlet splat = {};\nlet reconstructor = {};\n",
        rust_with(&look.splats.surfelizer, &placement),
        rust_with(&look.splats.splat, &radius),
        rust(&look.splats.reconstructor),
    )
}

fn depths(look: &Look) -> String {
    match look.effect {
        Effect::SoftShadows => format!("let settings = {};\n", rust(&look.shadows)),
        Effect::IndirectDiffuse => format!("let settings = {};\n", rust(&look.screen)),
        _ => format!(
            "let descriptor = VolumetricObscuranceDescriptor {{\n    sampling: ObscuranceSampling::{:?},\n    volume: \
             ObscuranceVolume::{:?},\n}};\nlet settings = {};\n",
            Sampling(look),
            look.volume,
            obscurance(&look.obscurance)
        ),
    }
}

fn obscurance(settings: &ObscuranceSettings) -> String {
    let second = settings.second.map(|second| {
        let (radius, combine) = (number(second.radius), second.combine);
        let text =
            format!("Some(SecondRadius {{ radius: {radius}, combine: Combine::{combine:?} }})");
        ("second", text)
    });
    rust_with(settings, second.as_slice())
}

fn hull(look: &Look) -> String {
    let quad = look.hull.quad;
    let quad: Vec<_> = (quad != SgHullSettings::default().quad)
        .then(|| ("quad", quad.to_string()))
        .into_iter()
        .collect();
    format!(
        "let size = {};\nlet components = Components::{:?};\nlet settings = {};\n",
        rust(&look.hull_size),
        look.components,
        rust_with(&look.hull, &quad),
    )
}

/// A sampling as Rust writes it.
struct Sampling<'a>(&'a Look);

impl std::fmt::Debug for Sampling<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        use deep_screen_space::ObscuranceSampling as Of;
        match self.0.sampling {
            Of::Points(table) => write!(f, "Points(BallSamples::{table:?})"),
            Of::Lines(table) => write!(f, "Lines(DiskSamples::{table:?})"),
            Of::Areas(table) => write!(f, "Areas(DiskSamples::{table:?})"),
            Of::OneArea => write!(f, "OneArea"),
        }
    }
}

#[cfg(test)]
mod tests {
    use deep_screen_space::{
        BounceSettings, Combine, Components, DiskSamples, ObscuranceSampling, Quality,
        RayTracedViewDescriptor, SecondRadius, TemporalSettings, wgpu::TextureFormat,
    };
    use support::gpu::{Ask, Gpu};

    use super::*;

    /// What is copied, compiled: the file is what `of` writes.
    #[rustfmt::skip]
    #[allow(clippy::pedantic, missing_docs)]
    mod copied {
        pub mod depths { include!("../tests/copied/depths.rs"); }
        pub mod hull { include!("../tests/copied/hull.rs"); }
        pub mod rays { include!("../tests/copied/rays.rs"); }
        pub mod splats { include!("../tests/copied/splats.rs"); }
    }

    fn look(effect: Effect, method: Method) -> Look {
        let mut look = Look::new(2.0, 1.0, Quality::Fast);
        look.choose(effect, Quality::Fast);
        look.method = method;
        look
    }

    /// A function around the statements, which gives what they define.
    fn around(text: &str, head: &str, last: &str) -> String {
        let text = text.replace('\n', "\n    ");
        format!("{head} {{\n    {}\n    {last}\n}}\n", text.trim_end())
    }

    /// That it is what was compiled; with `DSS_BLESS=1` it is from now on.
    fn check(name: &str, text: &str, compiled: &str) {
        if std::env::var_os("DSS_BLESS").is_some() {
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/copied");
            std::fs::write(format!("{folder}/{name}.rs"), text).unwrap();
        }
        assert_eq!(text, compiled, "{text}");
    }

    #[test]
    fn rays_are_as_copied() {
        let mut look = look(Effect::IndirectDiffuse, Method::Rays);
        look.temporal = Some(TemporalSettings {
            clamping: 0.5,
            ..TemporalSettings::default()
        });
        look.bounces = Some(BounceSettings::in_frame(3));
        look.sky_radiance = [1.0, 2.0, 3.0];
        look.aim(true);
        assert!(look.aims());
        let head = "use deep_screen_space::{wgpu::{Device, TextureFormat}, *};\n\npub fn made(device: Device, target: \
                    TextureFormat) -> Result<(RayTracedScene, RayTracedViewDescriptor, BounceSettings), Error>";
        let text = around(&of(&look), head, "Ok((scene, descriptor, bounces))");
        check("rays", &text, include_str!("../tests/copied/rays.rs"));
        let device = Gpu::open(Ask::Floor).unwrap().device;
        let made = copied::rays::made(device.clone(), TextureFormat::R8Unorm);
        let (_, descriptor, bounces) = made.unwrap();
        let RayTracedViewDescriptor {
            effect,
            rays,
            temporal,
            further_bounces,
            ..
        } = descriptor;
        assert_eq!((effect, rays), (look.ray_traced(), look.rays));
        assert_eq!(
            (temporal, Some(bounces)),
            (look.temporal, look.further_bounces())
        );
        assert!(further_bounces);
        // Without lamps the scene has no emitters, and is one of one bounce.
        look.aim(false);
        look.bounces = None;
        assert!(of(&look).contains("let scene = RayTracedScene::new(&device)?;\n"));
    }

    #[test]
    fn splats_are_as_copied() {
        let mut look = look(Effect::AmbientOcclusion, Method::Splats);
        look.splats.reconstructor.normal_power = 16.0;
        let head = "use deep_screen_space::*;\n\npub fn made() -> (Effect, SplatQuality)";
        let last = "(effect, SplatQuality { surfelizer, splat, reconstructor })";
        look.splats.surfelizer.placement = Placement::Random;
        let text = around(&of(&look), head, last);
        check("splats", &text, include_str!("../tests/copied/splats.rs"));
        let (_, splats) = copied::splats::made();
        assert_eq!(splats, look.splats);
    }

    #[test]
    fn depths_are_as_copied() {
        let mut look = look(Effect::AmbientOcclusion, Method::Depths);
        look.sampling = ObscuranceSampling::Areas(DiskSamples::Nine);
        look.obscurance.second = Some(SecondRadius {
            radius: 0.125,
            combine: Combine::Minimum,
        });
        let head = "use deep_screen_space::*;\n\npub fn made() -> (VolumetricObscuranceDescriptor, ObscuranceSettings)";
        let text = around(&of(&look), head, "(descriptor, settings)");
        check("depths", &text, include_str!("../tests/copied/depths.rs"));
        let (descriptor, settings) = copied::depths::made();
        assert_eq!(
            (descriptor.sampling, settings),
            (look.sampling, look.obscurance)
        );
    }

    #[test]
    fn the_hull_is_as_copied() {
        let mut look = look(Effect::IndirectDiffuse, Method::Hull);
        look.hull.quad = 16;
        look.hull_size.grid = 320;
        look.components = Components::Propagation;
        let head = "use deep_screen_space::*;\n\npub fn made(width: u32, height: u32) -> (SgHullSize, Components, SgHullSettings)";
        let text = around(&of(&look), head, "(size, components, settings)");
        check("hull", &text, include_str!("../tests/copied/hull.rs"));
        let made = copied::hull::made(1280, 720);
        assert_eq!(made, (look.hull_size, look.components, look.hull));
    }

    #[test]
    fn all_is_written() {
        for effect in Effect::ALL {
            for &method in effect.methods() {
                let text = of(&look(effect, method));
                assert!(text.starts_with("let "), "{text}");
                assert_eq!(
                    text.matches('{').count(),
                    text.matches('}').count(),
                    "{text}"
                );
            }
        }
    }
}
