use deep_screen_space::{wgpu::TextureFormat, *};

pub fn made(target: TextureFormat) -> (RayTracedViewDescriptor, BounceSettings) {
    let effect = RayTracedEffect::IndirectDiffuse { sky_radiance: [0.0; 3] };
    let rays = RaySettings {
        rays_per_pixel: 4,
        further: Some(RayBudgetSettings::default()),
        emitter_samples: 0,
        filter: HitResolverSettings {
            radius: 10,
            spread: 5.456317,
            damping: 0.3,
            narrowing: 0.6,
            ..HitResolverSettings::default()
        },
    };
    let bounces = BounceSettings {
        bounces: Bounces::InFrame(3),
        radius_pixels: 4.0,
        samples: 4,
        gatherer: SurfelGathererSettings {
            rays_per_surfel: 16,
            backs: true,
            most_albedo: 1.0,
            ..SurfelGathererSettings::default()
        },
    };
    let descriptor = RayTracedViewDescriptor {
        rays,
        temporal: Some(TemporalSettings {
            clamping: 0.5,
            ..TemporalSettings::default()
        }),
        further_bounces: true,
        ..RayTracedViewDescriptor::new(effect, Quality::Balanced, target)
    };
    (descriptor, bounces)
}
