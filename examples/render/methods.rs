//! The ways to render a picture.

use deep_screen_space::{
    AmbientOcclusion, BentNormals, CloudCapacity, DiffuseBounce, DirectionalOcclusion, Effect,
    Environment, EnvironmentBuilder, EnvironmentSettings, Error, HitResolverSettings, Overlap,
    Payload, Piece, Primitives, RaySettings, Sampling, SpecularBounce, SurfelCounts,
    reference::environment::Picture, scenes::Scene, wgpu,
};
use serde_json::{Value, json};

use super::{Options, view::Shot};
use support::{
    ambient_occlusion::Renderer,
    bounced::{BouncedRenderer, RayRoom},
    gpu::Gpu,
    lights::is_emissive,
    presets,
    raster::Raster,
    scene::SceneBuffers,
    sky,
};

/// A picture and what it took.
pub struct Rendered {
    /// Radiance, or visibility in all channels; rows from the top.
    pub pixels: Vec<[f32; 3]>,
    pub triangles: u32,
    pub capacity: CloudCapacity,
    pub counts: SurfelCounts,
    /// Whether the method makes surfels of the pieces at all.
    pub surfels_made: bool,
    pub passes: Vec<(&'static str, f64)>,
    pub memory_bytes: u64,
    pub settings: Value,
    /// The sky that it is under, for the effect that is of one.
    pub sky: Option<Picture>,
}

impl Rendered {
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }

    pub fn stats(&self, gpu: &Gpu, options: &Options, shot: &Shot, radius: f32) -> Value {
        let passes: Vec<_> = self
            .passes
            .iter()
            .map(|(name, ms)| json!({ "name": name, "ms": ms }))
            .collect();
        json!({
            "adapter": gpu.adapter.name,
            "driver": gpu.adapter.driver_info,
            "width": shot.width,
            "height": shot.height,
            "effect": options.effect,
            "method": options.method,
            "preset": options.preset,
            "radius": radius.is_finite().then_some(radius),
            "triangles": self.triangles,
            "triangles_rejected": self.counts.rejected,
            "pieces": self.counts.pieces,
            "pieces_merged": self.counts.merged,
            "piece_overflow": self.counts.piece_overflow(self.capacity),
            "surfels": self.counts.stored,
            "surfel_overflow": if self.surfels_made { self.counts.overflow() } else { 0 },
            "total_ms": self.total_ms(),
            "passes": passes,
            "memory_bytes": self.memory_bytes,
            "settings": self.settings,
        })
    }
}

/// The largest share of the pieces' area that a picture may be without.
const MOST_LOST: f64 = 1e-3;

/// Pieces that large triangles of a usual view come to.
const GUESS: u32 = 1000;

/// Renders with room for the pieces that the scene comes to, as far as the device has it. How many there are is known once
/// they were made: where the first guess was too low, with more room.
fn with_room<R, T>(
    (gpu, options, buffers): (&Gpu, &Options, &SceneBuffers),
    surfels: u32,
    create: impl Fn(CloudCapacity) -> Result<R, Error>,
    mut render: impl FnMut(&mut R) -> Result<T, Error>,
    outcome: impl Fn(&T) -> (f64, SurfelCounts),
) -> Result<(R, T, CloudCapacity), String> {
    let limits = gpu.device.limits();
    let bytes = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let most = (bytes / size_of::<Piece>() as u64).min(1 << 23) as u32;
    let mut capacity = CloudCapacity {
        surfels,
        pieces: options
            .pieces
            .unwrap_or_else(|| most.min(buffers.triangles().saturating_add(GUESS))),
        triangles: buffers.triangles(),
    };
    loop {
        let mut renderer = create(capacity).map_err(|e| e.to_string())?;
        let mut rendered = render(&mut renderer).map_err(|e| e.to_string())?;
        let (ms, counts) = outcome(&rendered);
        let wanted = counts.pieces.saturating_add(counts.merged).min(most);
        if options.pieces.is_none() && wanted > capacity.pieces {
            capacity.pieces = wanted;
            continue;
        }
        let lost = counts.lost_area_share();
        if lost > MOST_LOST {
            return Err(format!(
                "{:.2} % of the area found no room: the scene comes to {} pieces, {}",
                100.0 * lost,
                counts.pieces,
                if options.pieces.is_some() {
                    format!("--pieces gives room for {}", capacity.pieces)
                } else {
                    format!("the device has room for {most}")
                }
            ));
        }
        // Drivers compile a pipeline when it first runs.
        if ms < LONG {
            rendered = render(&mut renderer).map_err(|e| e.to_string())?;
        }
        return Ok((renderer, rendered, capacity));
    }
}

/// Milliseconds that make what a driver takes to compile pipelines, a second at most, a small share.
const LONG: f64 = 10_000.0;

/// Renders twice, since drivers compile a pipeline when it first runs: the second time is the one to report. Once, where it
/// takes long anyway.
pub fn twice<T>(
    mut render: impl FnMut() -> Result<T, deep_screen_space::Error>,
    total_ms: impl Fn(&T) -> f64,
) -> Result<T, String> {
    let first = render().map_err(|e| e.to_string())?;
    if total_ms(&first) > LONG {
        return Ok(first);
    }
    render().map_err(|e| e.to_string())
}

/// Sums over surfels: of form factors, or of what they send.
pub fn splat(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    radius: f32,
) -> Result<Rendered, String> {
    let preset = presets::preset(&options.preset, radius).ok_or("no such preset")?;
    let what = Splat {
        effect: &splatted(options).map_err(|e| e.to_string())?,
        preset,
    };
    let settings = json!({
        "two_sided": options.two_sided,
        "overlap": if options.independent { "independent" } else { "add" },
    });
    splat_of(gpu, options, scene, shot, (what, settings))
}

/// What is splatted, and how.
pub struct Splat<'a> {
    pub effect: &'a Effect,
    pub preset: presets::Preset,
}

/// Any effect; `settings` are of the effect itself.
pub fn splat_of(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    (what, mut settings): (Splat<'_>, Value),
) -> Result<Rendered, String> {
    let Splat { effect, mut preset } = what;
    if let Some(radius_pixels) = options.radius_pixels {
        preset.surfelizer.radius_pixels = radius_pixels;
    }
    if let Some(epsilon) = options.epsilon {
        preset.splat.epsilon = epsilon;
    }
    let camera = shot.camera()?;
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    if options.surfels == 0 {
        return Err("--method splat takes room for a surfel at least".into());
    }
    let shown = asked_sky(options, gpu)?;
    let size = [shot.width, shot.height];
    let (renderer, rendered, capacity) = with_room(
        (gpu, options, &buffers),
        options.surfels,
        |capacity| {
            let mut renderer =
                Renderer::of(gpu, effect, capacity, size, preset.splat.levels, false)?;
            if let Some(shown) = &shown {
                renderer.environment = Some(under(gpu, shown)?);
            }
            renderer.roughness = effect.roughness.then(|| roughness(gpu, options, size));
            Ok(renderer)
        },
        |renderer| renderer.render_scene(gpu, &raster, &buffers, &camera, &shot.lights, &preset),
        |rendered| (rendered.total_ms(), rendered.counts),
    )?;
    for (name, value) in [
        ("radius_pixels", preset.surfelizer.radius_pixels),
        ("density", preset.surfelizer.density),
        ("epsilon", preset.splat.epsilon),
        ("radius", preset.splat.radius),
        ("filter_radius", preset.reconstructor.radius),
        ("plane_distance", preset.reconstructor.plane_distance),
        ("normal_power", preset.reconstructor.normal_power),
    ] {
        settings[name] = json!(value.is_finite().then_some(value));
    }
    settings["levels"] = json!(preset.splat.levels);
    settings["unbounded"] = json!(preset.splat.unbounded);
    Ok(Rendered {
        pixels: match rendered.pictures.first() {
            Some(light) => light.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            None => rendered.visibility.iter().map(|&v| [v; 3]).collect(),
        },
        triangles: buffers.triangles(),
        capacity,
        counts: rendered.counts,
        surfels_made: true,
        memory_bytes: renderer.memory_bytes(),
        passes: rendered.passes,
        settings,
        sky: shown,
    })
}

fn splatted(options: &Options) -> Result<Effect, Error> {
    let two_sided = options.two_sided;
    let overlap = if options.independent {
        Overlap::Independent
    } else {
        Overlap::Add
    };
    match options.effect.as_str() {
        "gi" => DiffuseBounce {
            two_sided,
            ..DiffuseBounce::default()
        }
        .effect(),
        "specular" => SpecularBounce {
            two_sided,
            f0: [options.f0; 3],
            ..SpecularBounce::default()
        }
        .effect(),
        "do" => Ok(DirectionalOcclusion { two_sided, overlap }.effect()),
        "bent" => Ok(BentNormals { two_sided, overlap }.effect()),
        _ => {
            let effect = AmbientOcclusion {
                two_sided,
                overlap,
                ..AmbientOcclusion::default()
            };
            Ok(effect.effect())
        }
    }
}

/// The sky's picture, for the effect that is of one.
fn asked_sky(options: &Options, gpu: &Gpu) -> Result<Option<Picture>, String> {
    let most = gpu.device.limits().max_texture_dimension_2d;
    (options.effect == "do")
        .then(|| sky::open(&options.sky, most))
        .transpose()
}

/// The sky that was asked for, for rays and for sums.
fn under(gpu: &Gpu, shown: &Picture) -> Result<Environment, Error> {
    let builder = EnvironmentBuilder::new(&gpu.device)?;
    let settings = EnvironmentSettings {
        levels: true,
        ..EnvironmentSettings::default()
    };
    sky::build(gpu, &builder, shown, &settings)
}

/// That of all pixels alike.
fn roughness(gpu: &Gpu, options: &Options, [width, height]: [u32; 2]) -> wgpu::TextureView {
    let texels = vec![options.roughness; (width * height) as usize];
    gpu.texture(wgpu::TextureFormat::R32Float, width, height, &texels)
}

/// Nearest hits along directions of each pixel.
pub fn bounced(
    gpu: &Gpu,
    options: &Options,
    scene: &Scene,
    shot: &Shot,
    radius: f32,
) -> Result<Rendered, String> {
    let camera = shot.camera()?;
    let payload = match options.effect.as_str() {
        "gi" | "specular" => Payload::LitRadiance,
        "do" => Payload::Sky,
        _ => Payload::Occlusion,
    };
    let glossy = options.effect == "specular";
    let suited = |rays: RaySettings| {
        let rays = if glossy { rays.for_glossy() } else { rays };
        let set = rays.rays_per_pixel;
        match options.emitter_samples {
            Some(0) => rays,
            Some(aimed) => RaySettings {
                rays_per_pixel: set.saturating_sub(aimed).max(1),
                emitter_samples: aimed,
                ..rays.for_emitters()
            },
            None if options.light() && is_emissive(scene) => rays.for_emitters(),
            None => rays,
        }
    };
    let quality = presets::quality(&options.preset).ok_or("no such preset")?;
    let rays = if glossy {
        quality.glossy_rays()
    } else {
        quality.rays(payload)
    };
    let mut preset = presets::of(&suited(rays), radius);
    if let Some(rays_per_pixel) = options.rays_per_pixel {
        preset = presets::of(&suited(RaySettings::new(rays_per_pixel, payload)), radius);
    }
    if let Some(further) = options.further_rays {
        let rays_per_pixel = preset.bounced.rays_per_pixel + preset.emitter_samples;
        let rays = RaySettings::with_further(rays_per_pixel, further, payload);
        preset = presets::of(&suited(rays), radius);
    }
    if options.effect == "bent" {
        preset.reconstructor = HitResolverSettings::for_bent_normals(preset.bounced.rays_per_pixel);
    }
    preset.reconstructor.f0 = [options.f0; 3];
    if let Some(window) = options.window {
        preset.reconstructor.radius = window;
    }
    let buffers = SceneBuffers::new(gpu, scene);
    let raster = Raster::draw(gpu, &buffers, &camera);
    let size = [shot.width, shot.height];
    let rays_per_pixel = preset.bounced.rays_per_pixel;
    let room = RayRoom {
        rays_per_pixel,
        counted: preset.further.is_some(),
        bent_normals: options.effect == "bent",
        primitives: if scene.holes.is_some() {
            Primitives::AlphaTested
        } else {
            Primitives::Triangles
        },
        bounces: if options.gi() { options.bounces } else { 1 },
        sampling: if glossy {
            Sampling::Glossy
        } else {
            Sampling::default()
        },
        emitter_samples: preset.emitter_samples,
        ..RayRoom::default()
    };
    let surfels = if room.bounces > 1 { options.surfels } else { 0 };
    let lights = &shot.lights;
    let shown = asked_sky(options, gpu)?;
    let (renderer, picture, capacity) = with_room(
        (gpu, options, &buffers),
        surfels,
        |capacity| {
            let mut renderer = BouncedRenderer::new(gpu, payload, capacity, size, room)?;
            if let Some(shown) = &shown {
                renderer.scene.environment = Some(under(gpu, shown)?);
            }
            renderer.roughness = glossy.then(|| roughness(gpu, options, size));
            Ok(renderer)
        },
        |renderer| renderer.render(gpu, &raster, &buffers, &camera, lights, &preset),
        |picture| (picture.total_ms(), picture.counts),
    )?;
    Ok(Rendered {
        pixels: picture.radiance(),
        triangles: buffers.triangles(),
        capacity,
        counts: picture.counts,
        surfels_made: surfels > 0,
        memory_bytes: renderer.memory_bytes(),
        passes: picture.passes,
        settings: json!({
            "bounces": room.bounces,
            "rays_per_pixel": rays_per_pixel,
            "emitter_samples": preset.emitter_samples,
            "further_rays": preset.further.map_or(0.0, |further| further.rays_per_pixel),
            "window": preset.reconstructor.radius,
            "spread": preset.reconstructor.spread,
            "hit_distances": preset.reconstructor.hit_distances,
            "damping": preset.reconstructor.damping,
            "plane_distance": preset.reconstructor.plane_distance,
            "normal_power": preset.reconstructor.normal_power,
            "variance_clamp": preset.reconstructor.variance_clamp,
        }),
        sky: shown,
    })
}
