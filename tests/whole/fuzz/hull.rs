//! Hulls: light of polygons, lamps and surfels gathered at few points.

use std::rc::Rc;

use deep_screen_space::{
    AmbientOcclusion, Camera, Components, Error, GBuffer, Gatherer, GathererBinding, Placement,
    ReflectiveShadowMap, ReflectiveShadowMapInput, SgHull, SgHullDescriptor, SgHullInput,
    SgHullSettings, SgHullSize, SurfelLight, Viewport,
    glam::DVec3,
    wgpu::{TextureFormat as Format, TextureUsages},
};

use super::{
    case::{Case, Kind},
    inputs::{self, Part},
    rays, splats, surfels,
};

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Light {
    Polygons,
    Lamps,
    Surfels,
}

/// What a hull is made for: each takes pipelines of its own.
#[derive(Clone, Copy, Debug)]
struct Variant {
    light: Light,
    target: Format,
    albedo: bool,
    glossy: bool,
    components: Components,
}

const VARIANTS: [Variant; 4] = [
    Variant {
        light: Light::Polygons,
        target: Format::Rgba16Float,
        albedo: true,
        glossy: false,
        components: Components::UnionFind,
    },
    Variant {
        light: Light::Lamps,
        target: Format::Rgba32Float,
        albedo: false,
        glossy: true,
        components: Components::Propagation,
    },
    Variant {
        light: Light::Surfels,
        target: Format::Rgba16Float,
        albedo: false,
        glossy: false,
        components: Components::Propagation,
    },
    Variant {
        light: Light::Polygons,
        target: Format::Rgba16Float,
        albedo: true,
        glossy: true,
        components: Components::UnionFind,
    },
];

struct Made {
    gatherer: Gatherer,
    hull: SgHull,
}

impl Made {
    fn new(device: &deep_screen_space::wgpu::Device, variant: &Variant) -> Result<Self, Error> {
        let gatherer = match variant.light {
            Light::Polygons => Gatherer::polygons(device),
            Light::Lamps => Gatherer::lights(device),
            Light::Surfels => Gatherer::surfels(device),
        };
        let hull = SgHull::new(
            device,
            &SgHullDescriptor {
                gatherer: &gatherer,
                target: variant.target,
                albedo: variant.albedo,
                glossy: variant.glossy,
                components: variant.components,
            },
        )?;
        Ok(Self { gatherer, hull })
    }
}

pub fn record(case: &mut Case<'_>) {
    let _ = steps(case);
}

fn steps(case: &mut Case<'_>) -> Option<()> {
    let device = case.device();
    let variant = case.usual("hull", &VARIANTS);
    let key = (variant.light, variant.albedo, variant.glossy);
    let made = case.once(key, |device| Made::new(device, &variant))?;
    let camera = inputs::camera(case);
    let viewport = camera.viewport();
    let origin = match case.random.below(6) {
        0 => camera.eye() + case.random.point(1e3),
        1 if case.random.breaks() => DVec3::splat(case.random.odd().into()),
        _ => camera.eye(),
    };
    let lights = bind(case, &variant, &made, &camera, origin)?;
    let gbuffer = inputs::gbuffer(case, &camera, variant.albedo);
    let roughness =
        (variant.glossy && !case.random.breaks()).then(|| rays::roughness(case, viewport));
    let size = SgHullSize {
        width: viewport.width,
        height: viewport.height,
        grid: case.random.count(32, 4096),
        segments: 4096,
        per_pixel: 8192,
        splits: 4096,
    };
    let is_tight = case.random.chance(0.4);
    let size = if is_tight {
        // What finds room then is a matter of what comes first.
        case.any_order();
        SgHullSize {
            segments: case.random.one_of(&[0, 1, 8, 512]),
            per_pixel: case.random.one_of(&[1, 2, 64, 4096]),
            splits: case.random.one_of(&[0, 1, 7, 512]),
            ..size
        }
    } else {
        size
    };
    case.note("size", size);
    let view = made.hull.create_view(device, size);
    let view = case.accept(view)?;
    let mut quad = case.random.one_of(&[4, 8, 16, 32]);
    if case.random.breaks() {
        quad = case.random.count(0, 64);
    }
    let settings = SgHullSettings {
        quad,
        plane_distance: case.random.scale(f32::MIN_POSITIVE, f32::MAX),
        gap: case.random.scale(f32::MIN_POSITIVE, f32::MAX),
        normal_angle: case.random.setting(0.0, std::f32::consts::PI),
        error_threshold: case.random.scale(0.0, f32::INFINITY),
        f0: std::array::from_fn(|_| case.random.setting(0.0, 1.0)),
    };
    case.note("hull", settings);
    let target = inputs::target(
        case,
        variant.target,
        viewport,
        TextureUsages::RENDER_ATTACHMENT,
    );
    let gbuffer = GBuffer {
        roughness: roughness.as_ref().map(Part::slice),
        ..gbuffer.gbuffer()
    };
    let mut decoding = inputs::Decoding::new(case, viewport)?;
    let frame = decoding.frame(case, gbuffer, &camera, origin)?;
    let input = SgHullInput {
        frame: &frame,
        gather: lights.as_ref().filter(|_| !case.random.breaks()),
        target: target.slice(),
        timestamps: case.timestamps(),
    };
    let done = if case.random.chance(0.85) {
        made.hull
            .record(device, &mut case.encoder, &input, &settings, &view)
    } else {
        made.hull
            .record_per_pixel(device, &mut case.encoder, &input, &settings, &view)
    };
    case.accept(done)?;
    case.texture("picture", &target.texture);
    // Segments and with them vertices are in any order.
    case.buffer("counts", view.counts(), Kind::Bits);
    Some(())
}

#[allow(clippy::option_option)] // None ends the case, Some(None) is a hull whose gatherer binds nothing.
fn bind(
    case: &mut Case<'_>,
    variant: &Variant,
    made: &Rc<Made>,
    camera: &Camera,
    origin: DVec3,
) -> Option<Option<GathererBinding>> {
    let device = case.device();
    let group = match variant.light {
        Light::Polygons if case.random.chance(0.5) => {
            let polygons = 12 * (1 + case.random.below(9) as usize);
            let lights =
                inputs::table(case, "polygons", polygons, |i| (i as f32 * 2.1).sin() * 3.0);
            made.gatherer.bind_polygons(device, &lights)
        }
        Light::Polygons => {
            let map = case.once("", |device| ReflectiveShadowMap::new(device))?;
            let viewport = Viewport::full(1 + case.random.below(5), 1 + case.random.below(5));
            let seen_by = inputs::camera_of(case, viewport);
            let gbuffer = inputs::gbuffer(case, &seen_by, true);
            let view = map.create_view(device, viewport.width, viewport.height);
            let view = case.accept(view)?;
            let mut decoding = inputs::Decoding::new(case, viewport)?;
            let frame = decoding.frame(case, gbuffer.gbuffer(), &seen_by, origin)?;
            let input = ReflectiveShadowMapInput {
                frame: &frame,
                light: inputs::light(case, seen_by.eye()),
                timestamps: case.timestamps(),
            };
            let done = map.record(device, &mut case.encoder, &input, &view);
            case.accept(done)?;
            case.buffer("polygons", view.lights(), Kind::Floats);
            made.gatherer.bind_polygons(device, view.lights())
        }
        Light::Lamps => {
            let count = case.random.below(5);
            let lights: Vec<_> = (0..count)
                .map(|_| inputs::light(case, camera.eye()))
                .collect();
            made.gatherer.bind_lights(device, &lights, origin)
        }
        Light::Surfels => {
            let surfels = surfels::record(case, camera, &[Placement::Centroid])?;
            let settings = splats::settings(case);
            let effect = AmbientOcclusion::default().effect();
            let splatter = splats::splatter(case, &effect)?;
            let materials = inputs::materials(case);
            let clusters =
                splats::clusters(case, &splatter, &surfels, &settings, (&materials, None))?;
            let radiance = surfels::radiance(case, &surfels.cloud, camera, None)?;
            let light = SurfelLight {
                cloud: &surfels.cloud,
                clusters: &clusters,
                radiance: &radiance,
                settings,
            };
            made.gatherer
                .bind_surfels(device, &mut case.encoder, &light, origin)
        }
    };
    Some(Some(case.accept(group)?))
}
