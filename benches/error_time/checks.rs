//! What the depth-only methods must get right before they may stand for their kind: cases whose answer is known.

use std::f64::consts::PI;

use deep_screen_space::{
    Camera, Viewport,
    glam::DVec3,
    reference::{gbuffer, trace::Tracer},
    scenes::{Material, Part, Scene},
};

use support::depth_only::{AmbientOcclusionSettings, DepthOnly, Frame, IndirectSettings};
use support::{
    gpu::Gpu,
    raster::{Raster, perspective},
    scene::SceneBuffers,
};

const SIZE: [u32; 2] = [128, 96];
const RADIUS: f64 = 0.5;
/// Solid, for anything of these sizes: sectors must then tell what horizons do.
const SOLID: f32 = 100.0;

/// Four corners, counter-clockwise about the normal.
type Quad = ([[f32; 3]; 4], [f32; 3]);

const FLOOR: Quad = (
    [
        [-20.0, 0.0, -20.0],
        [-20.0, 0.0, 20.0],
        [20.0, 0.0, 20.0],
        [20.0, 0.0, -20.0],
    ],
    [0.0, 1.0, 0.0],
);
const WALL: Quad = (
    [
        [0.0, 0.0, -20.0],
        [0.0, 20.0, -20.0],
        [0.0, 20.0, 20.0],
        [0.0, 0.0, 20.0],
    ],
    [1.0, 0.0, 0.0],
);

/// How far off a picture may be, and why no less is beside each use.
struct Tolerance {
    rmse: f64,
    /// Of any pixel.
    most: f64,
}

/// A view with its G-buffer, and where each pixel is.
struct Set<'g> {
    gpu: &'g Gpu,
    camera: Camera,
    drawn: Raster,
    places: Vec<Option<DVec3>>,
    method: DepthOnly,
}

/// Fails with the first case that is off.
pub fn run(gpu: &Gpu) -> Result<(), String> {
    let plane = Set::new(gpu, &[FLOOR])?;
    let corner = Set::new(gpu, &[FLOOR, WALL])?;
    for thickness in [f32::INFINITY, SOLID] {
        for radius in [RADIUS as f32, f32::INFINITY] {
            // A plane hides nothing of itself, however it is tilted. What is left is the rounding of depth.
            let tolerance = Tolerance {
                rmse: 0.002,
                most: 0.01,
            };
            let image = plane.visibility(radius, thickness);
            let case = format!("open plane, radius {radius}, thickness {thickness}");
            plane.check(&case, &image, &tolerance, |_| Some(1.0))?;
        }
        // Taps a pixel apart miss the last of what is within the radius, a pixel being RADIUS / 25 here.
        let tolerance = Tolerance {
            rmse: 0.006,
            most: 0.025,
        };
        let image = corner.visibility(RADIUS as f32, thickness);
        let case = format!("inner corner, thickness {thickness}");
        corner.check(&case, &image, &tolerance, |place| {
            off_crease(place).map(|c| 1.0 - hidden_by_wall(c))
        })?;
    }
    let unlit = corner.indirect([0.0; 3]);
    let exact = Tolerance {
        rmse: 0.0,
        most: 0.0,
    };
    corner.check("unlit corner", &unlit, &exact, |_| Some(0.0))?;
    // All surfaces send 2, and half of what comes is sent on. As above; 64 directions are noisy besides.
    let tolerance = Tolerance {
        rmse: 0.01,
        most: 0.04,
    };
    let lit = corner.indirect([2.0; 3]);
    corner.check("lit corner", &lit, &tolerance, |place| {
        off_crease(place).map(hidden_by_wall)
    })
}

/// Distance of a place to the other plane of the corner, in radii. At the crease itself the pixels are too large, and
/// near the image's border occluders are beyond it.
fn off_crease(place: DVec3) -> Option<f64> {
    let distance = place.x.max(place.y);
    (distance > 0.05 && distance < 0.6 && place.z.abs() < 0.3)
        .then_some((distance / RADIUS).min(1.0))
}

/// What an endless wall within the radius hides of the cosine-weighted hemisphere: directions w with w.x > c, and so a
/// segment of the disk under the hemisphere.
fn hidden_by_wall(c: f64) -> f64 {
    (c.acos() - c * (1.0 - c * c).sqrt()) / PI
}

impl<'g> Set<'g> {
    fn new(gpu: &'g Gpu, quads: &[Quad]) -> Result<Self, String> {
        let [width, height] = SIZE;
        let aspect = f64::from(width) / f64::from(height);
        let camera = Camera::look_at(
            DVec3::new(1.5, 1.2, 0.3),
            DVec3::new(0.3, 0.2, 0.0),
            DVec3::Y,
            perspective(50.0, aspect, 0.1),
            Viewport::full(width, height),
        )
        .map_err(|e| e.to_string())?;
        let indices: Vec<u32> = (0..quads.len() as u32)
            .flat_map(|q| [0, 1, 2, 0, 2, 3].map(|i| 4 * q + i))
            .collect();
        let scene = Scene {
            holes: None,
            name: "checks",
            positions: quads.iter().flat_map(|q| q.0).collect(),
            normals: quads.iter().flat_map(|q| [q.1; 4]).collect(),
            parts: vec![Part {
                first_index: 0,
                index_count: indices.len() as u32,
                material: 0,
            }],
            indices,
            materials: vec![Material {
                albedo: [0.5; 3],
                emission: [0.0; 3],
                double_sided: false,
            }],
            views: Vec::new(),
            ao_radius: RADIUS as f32,
        };
        let tracer = Tracer::new(&scene.positions, &scene.indices).map_err(|e| e.to_string())?;
        let places = gbuffer::receivers(
            &camera,
            &tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        Ok(Self {
            gpu,
            drawn: Raster::draw(gpu, &SceneBuffers::new(gpu, &scene), &camera),
            places: places.iter().map(|r| r.map(|r| r.position)).collect(),
            camera,
            method: DepthOnly::new(&gpu.device, SIZE),
        })
    }

    fn frame(&self) -> Frame<'_> {
        Frame {
            camera: &self.camera,
            depth: &self.drawn.depth,
            normal: &self.drawn.normal,
        }
    }

    fn visibility(&self, radius: f32, thickness: f32) -> Vec<f32> {
        let device = &self.gpu.device;
        let target = self.method.create_target(device, DepthOnly::GRAY);
        let settings = AmbientOcclusionSettings {
            radius,
            slices: 16,
            taps: 32,
            thickness,
            filter_radius: 0,
        };
        let mut encoder = self.gpu.encoder();
        self.method.record_ambient_occlusion(
            device,
            &mut encoder,
            &self.frame(),
            &settings,
            &target,
        );
        self.gpu.finish(encoder);
        self.gpu.read_texture(target.texture(), 0)
    }

    /// The first channel, where every pixel sends this light and the albedo is one half.
    fn indirect(&self, [r, g, b]: [f32; 3]) -> Vec<f32> {
        let device = &self.gpu.device;
        let [width, height] = SIZE;
        let pixels = (width * height) as usize;
        let lit = vec![[r, g, b, 1.0]; pixels];
        let albedo = vec![[0.5_f32; 4]; pixels];
        let format = DepthOnly::COLOR;
        let lit = self.gpu.texture(format, width, height, &lit);
        let albedo = self.gpu.texture(format, width, height, &albedo);
        let target = self.method.create_target(device, format);
        let settings = IndirectSettings {
            radius: RADIUS as f32,
            directions: 64,
            steps: 64,
            thickness: 0.1,
            filter_radius: 1,
        };
        let mut encoder = self.gpu.encoder();
        self.method.record_indirect(
            device,
            &mut encoder,
            &self.frame(),
            [&lit, &albedo],
            &settings,
            &target,
        );
        self.gpu.finish(encoder);
        let texels: Vec<[f32; 4]> = self.gpu.read_texture(target.texture(), 0);
        texels.iter().map(|texel| texel[0]).collect()
    }

    /// Compares the pixels that have an answer.
    fn check(
        &self,
        case: &str,
        image: &[f32],
        tolerance: &Tolerance,
        answer: impl Fn(DVec3) -> Option<f64>,
    ) -> Result<(), String> {
        let (mut square, mut count) = (0.0, 0.0);
        let mut worst = (0.0, DVec3::ZERO, 0.0, 0.0);
        for (&value, place) in image.iter().zip(&self.places) {
            let Some((place, expected)) = place.and_then(|p| Some((p, answer(p)?))) else {
                continue;
            };
            let error = (f64::from(value) - expected).abs();
            square += error * error;
            count += 1.0;
            // What is not a number is worse than all, and stays.
            if error.is_nan() || error > worst.0 {
                worst = (error, place, f64::from(value), expected);
            }
        }
        let rmse = (square / f64::max(count, 1.0)).sqrt();
        let (most, place, value, expected) = worst;
        let Tolerance { rmse: r, most: m } = tolerance;
        let found = format!(
            "depth only, {case}: RMSE {rmse:.4} (accepted {r}); at most {most:.4} ({m}), at {place:.2} {value:.4} in place of \
             {expected:.4}; {count} pixels"
        );
        if count > 0.0 && rmse <= *r && most <= *m {
            println!("{found}");
            return Ok(());
        }
        Err(found)
    }
}
