//! The hull wired together: lights from a reflective shadow map, the picture, and the same gathered at every pixel.

use deep_screen_space::{
    Camera, Components, Error, GBuffer, Gatherer, GathererBinding, Light, ReflectiveShadowMap,
    ReflectiveShadowMapInput, ReflectiveShadowMapView, SgHull, SgHullCounts, SgHullDescriptor,
    SgHullInput, SgHullSettings, SgHullSize, SgHullView, Viewport,
    glam::{DMat4, DVec3},
    scenes::Scene,
    wgpu,
};

use super::{
    decoding::Decoding,
    gpu::Gpu,
    raster::{Raster, perspective},
    scene::SceneBuffers,
    stages::{Stages, Timed},
    visible::near_of,
    world::bounds_of,
};

/// [`SgHull::record`] or [`SgHull::record_per_pixel`].
type Record = fn(
    &SgHull,
    &wgpu::Device,
    &mut wgpu::CommandEncoder,
    &SgHullInput<'_>,
    &SgHullSettings,
    &SgHullView,
) -> Result<(), Error>;

/// The pipelines and one view.
pub struct HullRenderer {
    pub hull: SgHull,
    pub view: SgHullView,
    decoding: Decoding,
    map: ReflectiveShadowMap,
    map_decoding: Decoding,
    map_view: ReflectiveShadowMapView,
    gatherer: Gatherer,
    pub target: wgpu::TextureView,
    pub settings: SgHullSettings,
    roughness: Option<wgpu::TextureView>,
    /// What the lights are relative to.
    origin: DVec3,
}

/// Degrees that the map of a point light covers.
const MAP_DEGREES: f64 = 120.0;

/// Texels a side of the map: 256 lights, as in the paper.
pub const MAP: u32 = 16;

/// A light of a scene and the camera that sees what it lights.
pub struct LightSource {
    pub light: Light,
    pub camera: Camera,
}

impl LightSource {
    /// What lights a scene of the crate's: a lamp below the ceiling of a room, the sun elsewhere.
    pub fn of(scene: &Scene) -> Result<Self, Error> {
        match scene.name {
            "cornell" => Self::spot(
                [DVec3::new(0.0, 5.3, 0.0), DVec3::new(0.3, 0.0, -0.2)],
                1e-2,
                120.0,
                [17.0, 15.0, 12.0],
            ),
            "closed_room" => Self::spot(
                [DVec3::new(-2.0, 2.2, 1.5), DVec3::new(2.0, 0.5, -1.5)],
                1e-2,
                100.0,
                [17.0, 15.0, 12.0],
            ),
            _ => Self::sun(scene, DVec3::new(0.45, -0.8, -0.4), [3.2, 3.1, 2.9]),
        }
    }

    /// Of a view's own light, which shines toward what the eye looks at; what lights the scene where there is none.
    pub fn seen(
        scene: &Scene,
        light: Option<&Light>,
        [eye, target]: [DVec3; 2],
    ) -> Result<Self, Error> {
        match light {
            Some(Light::Directional {
                direction,
                irradiance,
            }) => Self::sun(scene, *direction, *irradiance),
            Some(
                Light::Point {
                    position,
                    intensity,
                }
                | Light::Spot {
                    position,
                    intensity,
                    ..
                },
            ) => {
                // From the target itself, on along the line of sight.
                let target = match target.distance(*position) {
                    0.0 => 2.0 * target - eye,
                    _ => target,
                };
                let near = near_of(scene, *position, 1e-2 * target.distance(*position));
                Self::spot([*position, target], near, MAP_DEGREES, *intensity)
            }
            None => Self::of(scene),
        }
    }

    /// A spot light, and the distance of the near plane of its map.
    pub fn spot(
        [position, target]: [DVec3; 2],
        near: f64,
        degrees: f64,
        intensity: [f32; 3],
    ) -> Result<Self, Error> {
        let direction = target - position;
        let up = direction.any_orthogonal_vector();
        let outer = (degrees.to_radians() / 2.0) as f32;
        Ok(Self {
            light: Light::Spot {
                position,
                direction,
                intensity,
                inner: 0.9 * outer,
                outer,
            },
            camera: Camera::look_at(
                position,
                target,
                up,
                perspective(degrees, 1.0, near),
                Viewport::full(MAP, MAP),
            )?,
        })
    }

    /// A directional light over a whole scene.
    pub fn sun(scene: &Scene, direction: DVec3, irradiance: [f32; 3]) -> Result<Self, Error> {
        let (low, high) = bounds_of(scene);
        let direction = direction.normalize();
        let radius = 0.5 * (high - low).length();
        // Depth 1 at the near plane and 0 at the far one.
        let (near, far) = (0.5 * radius, 4.0 * radius);
        let scale = 1.0 / (far - near);
        let projection = DMat4::from_cols_array(&[
            1.0 / radius,
            0.0,
            0.0,
            0.0, //
            0.0,
            1.0 / radius,
            0.0,
            0.0, //
            0.0,
            0.0,
            scale,
            0.0, //
            0.0,
            0.0,
            far * scale,
            1.0,
        ]);
        Ok(Self {
            light: Light::Directional {
                direction,
                irradiance,
            },
            camera: Camera::look_at(
                0.5 * (low + high) - 2.0 * radius * direction,
                0.5 * (low + high),
                direction.any_orthogonal_vector(),
                projection,
                Viewport::full(MAP, MAP),
            )?,
        })
    }
}

impl HullRenderer {
    pub fn new(gpu: &Gpu, size: SgHullSize, components: Components) -> Result<Self, Error> {
        Self::with_roughness(gpu, size, components, None)
    }

    /// Of surfaces that are glossy besides, where there is a roughness.
    pub fn with_roughness(
        gpu: &Gpu,
        size: SgHullSize,
        components: Components,
        roughness: Option<f32>,
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let gatherer = Gatherer::polygons(device);
        let format = wgpu::TextureFormat::Rgba32Float;
        let hull = SgHull::new(
            device,
            &SgHullDescriptor {
                gatherer: &gatherer,
                target: format,
                albedo: true,
                glossy: roughness.is_some(),
                components,
            },
        )?;
        let map = ReflectiveShadowMap::new(device)?;
        Ok(Self {
            decoding: Decoding::new(gpu, [size.width, size.height])?,
            map_decoding: Decoding::new(gpu, [MAP, MAP])?,
            view: hull.create_view(device, size)?,
            map_view: map.create_view(device, MAP, MAP)?,
            target: gpu.target(format, size.width, size.height),
            hull,
            map,
            gatherer,
            settings: SgHullSettings::default(),
            origin: DVec3::ZERO,
            roughness: roughness.map(|roughness| {
                let [width, height] = [size.width, size.height];
                let texels = vec![roughness; (width * height) as usize];
                gpu.texture(wgpu::TextureFormat::R32Float, width, height, &texels)
            }),
        })
    }

    /// Makes the lights of a lamp, relative to a point as pictures then are: what they are bound as.
    pub fn lights(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lamp: &LightSource,
        origin: DVec3,
    ) -> Result<GathererBinding, Error> {
        self.origin = origin;
        let raster = Raster::draw(gpu, scene, &lamp.camera);
        let decoding = &mut self.map_decoding;
        let (_, frame) = decoding.frame(gpu, raster.gbuffer(), &lamp.camera, origin)?;
        let mut encoder = gpu.encoder();
        let input = ReflectiveShadowMapInput::new(&frame, lamp.light);
        self.map
            .record(&gpu.device, &mut encoder, &input, &self.map_view)?;
        gpu.finish(encoder);
        self.gatherer.bind_map(&gpu.device, &self.map_view)
    }

    /// Milliseconds, and the picture by the hull.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        camera: &Camera,
        lights: &GathererBinding,
    ) -> Result<(f64, Vec<[f32; 4]>), Error> {
        self.render_by(gpu, raster, camera, lights, SgHull::record)
    }

    /// Milliseconds, and the picture with the light gathered at every pixel.
    pub fn render_per_pixel(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        camera: &Camera,
        lights: &GathererBinding,
    ) -> Result<(f64, Vec<[f32; 4]>), Error> {
        self.render_by(gpu, raster, camera, lights, SgHull::record_per_pixel)
    }

    fn render_by(
        &mut self,
        gpu: &Gpu,
        raster: &Raster,
        camera: &Camera,
        lights: &GathererBinding,
        record: Record,
    ) -> Result<(f64, Vec<[f32; 4]>), Error> {
        let mut stages = Timed::new(gpu);
        self.record_by(gpu, &mut stages, (raster, camera, lights), record)?;
        let ms = stages.passes.iter().map(|pass| pass.1).sum();
        Ok((ms, gpu.read_texture(self.target.texture(), 0)))
    }

    /// Records the picture by the hull.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        what: (&Raster, &Camera, &GathererBinding),
    ) -> Result<(), Error> {
        self.record_by(gpu, stages, what, SgHull::record)
    }

    fn record_by(
        &mut self,
        gpu: &Gpu,
        stages: &mut impl Stages,
        (raster, camera, lights): (&Raster, &Camera, &GathererBinding),
        record: Record,
    ) -> Result<(), Error> {
        let gbuffer = GBuffer {
            roughness: self.roughness.as_ref().map(|view| view.texture().into()),
            ..raster.gbuffer()
        };
        let decoding = &mut self.decoding;
        let frame = decoding.staged(gpu, stages, gbuffer, camera, self.origin)?;
        let input = SgHullInput::new(&frame, Some(lights), self.target.texture());
        let (hull, settings, view) = (&self.hull, &self.settings, &self.view);
        stages.stage("hull", |encoder| {
            record(hull, &gpu.device, encoder, &input, settings, view)
        })
    }

    pub fn counts(&self, gpu: &Gpu) -> SgHullCounts {
        gpu.read_buffer(self.view.counts())[0]
    }
}

/// How a picture differs from the truth.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Root mean square over pixels and channels, relative to the truth's mean.
    pub rmse: f64,
    /// Sum over sum, less 1.
    pub energy: f64,
    /// The 99.99th percentile of the ratio of luminances, either way, where the truth is above a hundredth of its mean.
    pub ratio: f64,
    /// Structural similarity of luminances, 1 where they are the same (Wang, Bovik, Sheikh and Simoncelli 2004), the mean
    /// over windows of 8 × 8 pixels, 4 apart, with their constants. Luminances are mapped to 0…1 by `x / (x + mean)`.
    pub ssim: f64,
}

/// Of two pictures of that width.
pub fn difference(found: &[[f32; 4]], truth: &[[f32; 4]], width: u32) -> Difference {
    let (mut squares, mut sum, mut total) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (f, t) in found.iter().zip(truth) {
        for c in 0..3 {
            let (f, t) = (f64::from(f[c]), f64::from(t[c]));
            squares += (f - t).powi(2);
            sum += f;
            total += t;
        }
    }
    let count = 3.0 * truth.len() as f64;
    let mean = total / count;
    let luminance = |p: &[f32; 4]| f64::from(p[0] + p[1] + p[2]) / 3.0;
    let mut ratios: Vec<f64> = found
        .iter()
        .zip(truth)
        .filter(|(_, t)| luminance(t) > 0.01 * mean)
        .map(|(f, t)| luminance(f) / luminance(t))
        .collect();
    ratios.sort_by(f64::total_cmp);
    let at = (ratios.len() as f64 * 0.9999) as usize;
    Difference {
        rmse: (squares / count).sqrt() / mean.max(1e-30),
        energy: sum / total.max(1e-30) - 1.0,
        ratio: ratios
            .get(at.min(ratios.len().saturating_sub(1)))
            .copied()
            .unwrap_or(1.0),
        ssim: {
            let mapped = |pixels: &[[f32; 4]]| -> Vec<f64> {
                let luminances = pixels.iter().map(luminance);
                luminances.map(|l| l / (l + mean.max(1e-30))).collect()
            };
            similarity(&mapped(found), &mapped(truth), width as usize)
        },
    }
}

fn similarity(a: &[f64], b: &[f64], width: usize) -> f64 {
    const WINDOW: usize = 8;
    let (c1, c2) = (0.01_f64.powi(2), 0.03_f64.powi(2));
    let (mut sum, mut windows) = (0.0, 0.0_f64);
    let starts = |n: usize| (0..(n + 1).saturating_sub(WINDOW)).step_by(WINDOW / 2);
    for top in starts(a.len() / width.max(1)) {
        for left in starts(width) {
            // Sums of a, b, a², b² and ab.
            let mut s = [0.0; 5];
            for y in top..top + WINDOW {
                for i in y * width + left..y * width + left + WINDOW {
                    let terms = [a[i], b[i], a[i] * a[i], b[i] * b[i], a[i] * b[i]];
                    for (s, term) in s.iter_mut().zip(terms) {
                        *s += term / (WINDOW * WINDOW) as f64;
                    }
                }
            }
            let [ma, mb, aa, bb, ab] = s;
            let (va, vb, covariance) = (aa - ma * ma, bb - mb * mb, ab - ma * mb);
            sum += (2.0 * ma * mb + c1) * (2.0 * covariance + c2)
                / ((ma * ma + mb * mb + c1) * (va + vb + c2));
            windows += 1.0;
        }
    }
    if windows > 0.0 { sum / windows } else { 1.0 }
}
