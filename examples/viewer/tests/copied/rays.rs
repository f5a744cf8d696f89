use deep_screen_space::{wgpu::{Device, TextureFormat}, *};

pub fn made(device: Device, target: TextureFormat) -> Result<(RayTracedScene, RayTracedViewDescriptor, BounceSettings), Error> {
    let effect = RayTracedEffect::IndirectDiffuse { sky_radiance: [1.0, 2.0, 3.0] };
    let rays = RaySettings {
        rays_per_pixel: 3,
        further: Some(RayBudgetSettings::default()),
        emitter_samples: 1,
        filter: HitResolverSettings {
            radius: 10,
            spread: 5.456317,
            damping: 0.3,
            variance_clamp: 2.0,
            narrowing: 0.6,
            ..HitResolverSettings::default()
        },
    };
    let bounces = BounceSettings {
        bounces: Bounces::InFrame(3),
        radius_pixels: 4.0,
        samples: 4,
        gatherer: SurfelGathererSettings {
            rays_per_surfel: 13,
            emitter_samples: 3,
            backs: true,
            most_albedo: 1.0,
            sky_radiance: [1.0, 2.0, 3.0],
            frame: 0,
        },
    };
    let scene = RayTracedScene::with_bounces(&device, Primitives::Triangles, bounces)?.with_emitters(&device)?;
    let descriptor = RayTracedViewDescriptor {
        rays,
        temporal: Some(TemporalSettings {
            clamping: 0.5,
            ..TemporalSettings::default()
        }),
        further_bounces: true,
        ..RayTracedViewDescriptor::new(effect, Quality::Balanced, target)
    };
    Ok((scene, descriptor, bounces))
}
