//! A view of a scene: its G-buffer, and the truth about it.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, Light, Viewport,
    glam::{DQuat, DVec3},
    reference::{
        environment::{Cells, Picture},
        gbuffer,
        trace::{BentEstimate, ColorEstimate, Estimate, Gloss, Receiver, Tracer},
    },
    scenes::{Scene, View},
};
use serde::Serialize;

use crate::{
    calibration::Subject,
    gpu::Gpu,
    raster::{self, Raster},
    scene::SceneBuffers,
};

/// How much work to put into the figures.
pub struct Effort {
    pub size: [u32; 2],
    pub rays: u32,
    pub runs: u32,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Effect {
    /// Ambient occlusion.
    Ao,
    /// One bounce of diffuse light.
    Gi,
}

impl Effect {
    pub fn name(self) -> &'static str {
        match self {
            Self::Ao => "ao",
            Self::Gi => "gi",
        }
    }
}

/// A view with its G-buffer and rays.
pub struct Stage<'g> {
    pub gpu: &'g Gpu,
    pub effort: &'g Effort,
    pub scene: &'g Scene,
    pub camera: Camera,
    pub buffers: SceneBuffers,
    pub drawn: Raster,
    /// What shines besides the scene's own surfaces.
    pub lights: Vec<Light>,
    tracer: Tracer,
    receivers: Vec<Option<Receiver>>,
}

/// How far a surface's depth, one over a distance, may be from what was drawn, relative, and the cosine between both normals: far
/// more than rounding brings, and less than there is between surfaces.
const SAME_DEPTH: f64 = 1e-3;
const SAME_NORMAL: f64 = 0.99;

/// The traced truth of a view within a radius.
pub struct Truth {
    pub estimates: Vec<Option<Estimate>>,
    /// What the estimates, and all values to be compared with them, are in units of.
    pub level: f64,
    /// Where it is known.
    pub depth_alone_rmse: Option<f64>,
}

impl Truth {
    /// Of luminances.
    fn of_light(estimates: Vec<Option<Estimate>>) -> Self {
        let seen = estimates.iter().flatten();
        let level = seen.clone().map(|e| e.mean).sum::<f64>() / seen.count().max(1) as f64;
        let level = if level > 0.0 { level } else { 1.0 };
        let relative = |e: Estimate| Estimate {
            mean: e.mean / level,
            standard_error: e.standard_error / level,
        };
        Self {
            estimates: estimates.into_iter().map(|e| e.map(relative)).collect(),
            level,
            depth_alone_rmse: None,
        }
    }
}

/// Its luminance. That of the standard errors is at least the luminance's own.
fn grey(color: Option<ColorEstimate>) -> Option<Estimate> {
    color.map(|color| Estimate {
        mean: luminance(color.mean),
        standard_error: luminance(color.standard_error),
    })
}

impl<'g> Stage<'g> {
    pub fn new(
        gpu: &'g Gpu,
        effort: &'g Effort,
        (scene, view): (&'g Scene, &View),
    ) -> Result<Self, String> {
        let [width, height] = effort.size;
        let aspect = f64::from(width) / f64::from(height);
        let camera = Camera::look_at(
            view.eye.into(),
            view.target.into(),
            view.up.into(),
            raster::perspective(view.vertical_fov_degrees, aspect, view.near),
            Viewport::full(width, height),
        )
        .map_err(|e| e.to_string())?;
        let buffers = SceneBuffers::new(gpu, scene);
        // From above the viewer's shoulder; closed scenes have lights of their own.
        let ahead = (DVec3::from(view.target) - DVec3::from(view.eye)).normalize();
        let up = DVec3::from(view.up).normalize();
        let lights = vec![Light::Directional {
            direction: ahead - up + 0.5 * ahead.cross(up),
            irradiance: [3.0, 2.8, 2.5],
        }];
        let tracer = Tracer::of_scene(scene).map_err(|e| e.to_string())?;
        Ok(Self {
            gpu,
            effort,
            scene,
            drawn: Raster::draw(gpu, &buffers, &camera),
            receivers: gbuffer::receivers(
                &camera,
                &tracer,
                &scene.positions,
                &scene.normals,
                &scene.indices,
            ),
            camera,
            buffers,
            lights,
            tracer,
        })
    }

    /// What to render.
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            gpu: self.gpu,
            size: self.effort.size,
            camera: &self.camera,
            buffers: &self.buffers,
            drawn: &self.drawn,
            lights: &self.lights,
            sky: None,
            roughness: 0.3,
        }
    }

    pub fn truth(&self, radius: f32) -> Result<Truth, String> {
        let rays = self.effort.rays;
        let trace = |tracer: &Tracer, rays, seed| {
            tracer.ambient_occlusion_image(&self.receivers, f64::from(radius), rays, seed, false)
        };
        let estimates = trace(&self.tracer, rays, 1);
        let mut depth_alone_rmse = f64::INFINITY;
        for steepest in [1.1, f64::INFINITY] {
            let (positions, indices) = self.pixel_surface(steepest);
            let tracer = Tracer::new(&positions, &indices).map_err(|e| e.to_string())?;
            let visibility: Vec<f32> = trace(&tracer, rays, 2)
                .iter()
                .map(|e| e.map_or(1.0, |e| e.mean as f32))
                .collect();
            depth_alone_rmse = depth_alone_rmse.min(compare(&visibility, &estimates).0);
        }
        Ok(Truth {
            estimates,
            level: 1.0,
            depth_alone_rmse: Some(depth_alone_rmse),
        })
    }

    /// The traced luminance of one bounce, in units of its mean over the pixels.
    pub fn light_truth(&self) -> Truth {
        let materials = self.scene.triangle_materials();
        let rays = 4 * self.effort.rays;
        let traced =
            self.tracer
                .one_bounce_image(&self.receivers, &materials, &self.lights, rays, 1, false);
        let estimates: Vec<_> = traced
            .iter()
            .zip(self.pixels())
            .map(|(estimate, pixel)| {
                let (estimate, pixel) = (estimate.as_ref()?, pixel?);
                let albedo = DVec3::from(materials[pixel.triangle].albedo.map(f64::from));
                Some(Estimate {
                    mean: luminance(estimate.mean * albedo),
                    standard_error: luminance(estimate.standard_error * albedo),
                })
            })
            .collect();
        Truth::of_light(estimates)
    }

    /// The traced luminance of what a white surface sends on of a sky, in units of its mean over the pixels.
    pub fn sky_truth(&self, sky: &Picture, radius: f32) -> Truth {
        let cells = Cells::new(sky.clone(), DQuat::IDENTITY);
        let how = (f64::from(radius), 8 * self.effort.rays);
        let traced = self
            .tracer
            .environment_image(&self.third(), &cells, how, 1, false);
        Truth::of_light(traced.into_iter().map(grey).collect())
    }

    /// The traced luminance of one bounce off glossy surfaces, in units of its mean over the pixels.
    pub fn glossy_truth(&self, roughness: f32) -> Truth {
        let materials = self.scene.triangle_materials();
        let gloss = Gloss {
            eye: self.camera.eye(),
            roughness: roughness.into(),
            f0: DVec3::splat(0.04),
        };
        let (sources, how) = (
            (&materials[..], &self.lights[..]),
            (16 * self.effort.rays, 1),
        );
        let traced = self
            .tracer
            .glossy_image(&self.third(), &gloss, sources, how, false);
        Truth::of_light(traced.into_iter().map(grey).collect())
    }

    /// The traced mean directions in which nothing is, by two sets of rays that know nothing of each other.
    pub fn bent_truth(&self, radius: f32) -> [Vec<Option<BentEstimate>>; 2] {
        let (receivers, rays) = (self.third(), 8 * self.effort.rays);
        let image = |seed| {
            self.tracer
                .bent_normal_image(&receivers, f64::from(radius), rays, seed, false)
        };
        [1, 2].map(image)
    }

    /// One receiver of three, of which no row, column or square of pixels has more than others. Those are left out where a ray
    /// through the pixel's middle meets another surface than was drawn there, as along some edges: what is told of the one is
    /// not true of the other.
    fn third(&self) -> Vec<Option<Receiver>> {
        let width = self.effort.size[0] as usize;
        let depths: Vec<f32> = self.gpu.read_texture(self.drawn.depth.texture(), 0);
        let normals: Vec<[f32; 4]> = self.gpu.read_texture(self.drawn.normal.texture(), 0);
        let is_drawn = |i: usize, receiver: &Receiver| {
            let [x, y, z, _] = normals[i].map(f64::from);
            let place = self.camera.project(receiver.position - self.camera.eye());
            let depth = place.map_or(0.0, |place| place.z);
            let turned = DVec3::new(x, y, z).dot(receiver.shading_normal.normalize_or_zero());
            (f64::from(depths[i]) - depth).abs() < SAME_DEPTH * depth && turned > SAME_NORMAL
        };
        let receivers = self.receivers.iter().enumerate();
        let taken = |(i, receiver): (usize, &Option<Receiver>)| {
            let receiver = (*receiver)?;
            let third = (i % width + i / width).is_multiple_of(3);
            (third && is_drawn(i, &receiver)).then_some(receiver)
        };
        receivers.map(taken).collect()
    }

    /// What each pixel sends towards the eye of the light that reaches it straight, and of its own: what a depth-only method
    /// bounces.
    pub fn direct_light(&self) -> Vec<[f32; 4]> {
        let materials = self.scene.triangle_materials();
        self.pixels()
            .into_iter()
            .map(|pixel| {
                let Some(pixel) = pixel else {
                    return [0.0; 4];
                };
                let material = &materials[pixel.triangle];
                let albedo = DVec3::from(material.albedo.map(f64::from));
                let own = DVec3::from(material.emission.map(f64::from)) / PI;
                let at = pixel.receiver;
                let lit =
                    self.tracer
                        .direct(at.position, at.geometric_normal, albedo, &self.lights);
                (own + lit).as_vec3().extend(1.0).to_array()
            })
            .collect()
    }

    fn pixels(&self) -> Vec<Option<gbuffer::Pixel>> {
        gbuffer::cast(
            &self.camera,
            &self.tracer,
            &self.scene.positions,
            &self.scene.normals,
            &self.scene.indices,
        )
    }

    /// The surface through all pixels, two triangles between four neighbours. Across an edge in depth, where one neighbour
    /// is more than `steepest` times as far as another, there is none.
    fn pixel_surface(&self, steepest: f64) -> (Vec<[f32; 3]>, Vec<u32>) {
        let [width, height] = self.effort.size;
        let positions = self
            .receivers
            .iter()
            .map(|r| r.map_or([f32::NAN; 3], |r| r.position.as_vec3().to_array()))
            .collect();
        let distance =
            |i: u32| self.receivers[i as usize].map(|r| r.position.distance(self.camera.eye()));
        let mut indices = Vec::new();
        for y in 0..height - 1 {
            for x in 0..width - 1 {
                let a = y * width + x;
                let corners = [a, a + 1, a + width, a + width + 1];
                let distances: Option<Vec<f64>> = corners.iter().map(|&i| distance(i)).collect();
                let Some(distances) = distances else { continue };
                let near = distances.iter().copied().fold(f64::INFINITY, f64::min);
                let far = distances.iter().copied().fold(0.0, f64::max);
                if far <= steepest * near {
                    let [a, b, c, d] = corners;
                    indices.extend([a, c, b, b, c, d]);
                }
            }
        }
        (positions, indices)
    }
}

/// Of linear Rec. 709 RGB.
pub fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Root of the mean squared error, less the truth's own variance, and the mean error, over pixels with a surface.
pub fn compare(values: &[f32], truth: &[Option<Estimate>]) -> (f64, f64) {
    let (mut square, mut sum, mut count) = (0.0, 0.0, 0_u32);
    for (&v, estimate) in values.iter().zip(truth) {
        if let Some(estimate) = estimate {
            let error = f64::from(v) - estimate.mean;
            square += error * error - estimate.standard_error * estimate.standard_error;
            sum += error;
            count += 1;
        }
    }
    let n = f64::from(count.max(1));
    ((square.max(0.0) / n).sqrt(), sum / n)
}
