//! A scene's first view: its G-buffer, and the truth about it.

use deep_screen_space::{
    Camera, Viewport,
    reference::{
        gbuffer,
        trace::{Estimate, Receiver, Tracer},
    },
    scenes::Scene,
};

use super::support::{
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

/// A scene's first view with its G-buffer and rays.
pub struct Stage<'g> {
    pub gpu: &'g Gpu,
    pub effort: &'g Effort,
    pub scene: &'g Scene,
    pub camera: Camera,
    pub buffers: SceneBuffers,
    pub drawn: Raster,
    tracer: Tracer,
    receivers: Vec<Option<Receiver>>,
}

/// The traced truth of a view within a radius.
pub struct Truth {
    pub estimates: Vec<Option<Estimate>>,
    pub depth_alone_rmse: f64,
}

impl<'g> Stage<'g> {
    pub fn new(gpu: &'g Gpu, effort: &'g Effort, scene: &'g Scene) -> Result<Self, String> {
        let view = &scene.views[0];
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
        let tracer = Tracer::new(&scene.positions, &scene.indices).map_err(|e| e.to_string())?;
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
            tracer,
        })
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
            depth_alone_rmse,
        })
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

/// Root of the mean squared error, less the truth's own variance, and the mean error, over pixels with a surface.
pub fn compare(visibility: &[f32], truth: &[Option<Estimate>]) -> (f64, f64) {
    let (mut square, mut sum, mut count) = (0.0, 0.0, 0_u32);
    for (&v, estimate) in visibility.iter().zip(truth) {
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
