//! What tests of splatted effects share: what surfels send, a scene that hides nothing, and how far pictures are off.

use deep_screen_space::{
    Camera, CloudCapacity, Effect, SplatSettings, SurfelRadiance, Viewport,
    glam::DVec3,
    scenes::{self, Material, Part, Scene},
};
use support::{
    ambient_occlusion::Renderer,
    gpu::Gpu,
    presets::{self, Preset},
    raster::perspective,
    testing::{shot::Shot, splats::Options},
};

pub fn color(texel: [f32; 4]) -> DVec3 {
    DVec3::new(texel[0].into(), texel[1].into(), texel[2].into())
}

/// With what each surfel sends: as many as the cloud has room for.
pub fn lit(splat: SplatSettings, sent: impl Fn(u32) -> Vec<SurfelRadiance>) -> Options {
    let mut options = Options::new(splat);
    options.radiance = Some(sent(options.capacity.surfels));
    options
}

/// All send the same.
pub fn alike(radiance: SurfelRadiance) -> impl Fn(u32) -> Vec<SurfelRadiance> {
    move |count| vec![radiance; count as usize]
}

/// Different for each surfel: a third are black, and another third's backs alone send anything.
pub fn radiances(count: u32) -> Vec<SurfelRadiance> {
    let color = |i: u32| [17, 29, 43].map(|k| (i * k % 64) as f32 / 32.0);
    let of = |i: u32| SurfelRadiance {
        front: if i.is_multiple_of(3) {
            color(i)
        } else {
            [0.0; 3]
        },
        back: if i % 3 == 2 { [0.0; 3] } else { color(i + 7) },
        ..SurfelRadiance::default()
    };
    (0..count).map(of).collect()
}

/// A floor, and a wall across it that glows: nothing hides behind anything else, so that sums are right.
pub fn floor_and_wall() -> Scene {
    let quad = |[a, b, c, d]: [[f32; 3]; 4]| [a, b, c, a, c, d];
    let floor = [
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
        [-2.0, 0.0, -2.0],
    ];
    let wall = [
        [-1.5, 0.0, 0.0],
        [1.5, 0.0, 0.0],
        [1.5, 1.5, 0.0],
        [-1.5, 1.5, 0.0],
    ];
    let of = |emission, albedo| Material {
        albedo,
        emission,
        double_sided: false,
    };
    let part = |material: u32| Part {
        first_index: 6 * material,
        index_count: 6,
        material,
    };
    Scene {
        name: "floor and wall",
        positions: [quad(floor), quad(wall)].concat(),
        normals: [[[0.0, 1.0, 0.0]; 6], [[0.0, 0.0, 1.0]; 6]].concat(),
        indices: (0..12).collect(),
        parts: vec![part(0), part(1)],
        materials: vec![of([0.0; 3], [0.7, 0.6, 0.5]), of([6.0, 4.0, 2.0], [0.5; 3])],
        ..scenes::cornell()
    }
}

/// From in front and above.
pub fn seen(gpu: &Gpu, floor_and_wall: &Scene, size: [u32; 2]) -> Shot {
    let camera = Camera::look_at(
        DVec3::new(0.7, 1.3, 3.0),
        DVec3::new(0.0, 0.5, 0.0),
        DVec3::Y,
        perspective(60.0, 1.5, 0.1),
        Viewport::full(size[0], size[1]),
    )
    .expect("a camera");
    Shot::new(gpu, floor_and_wall, &camera)
}

/// What renders an effect of a shot at the balanced preset, with room for all of these.
pub fn balanced(gpu: &Gpu, effect: &Effect, shot: &Shot, radius: f32) -> (Renderer, Preset) {
    let capacity = CloudCapacity {
        surfels: 1 << 16,
        pieces: 1 << 16,
        triangles: shot.buffers.triangles(),
    };
    let preset = presets::preset("balanced", radius).expect("a preset");
    let Viewport { width, height, .. } = shot.camera.viewport();
    let size = [width, height];
    let renderer = Renderer::of(gpu, effect, capacity, size, preset.splat.levels, false);
    (renderer.expect("within limits"), preset)
}

/// Root mean square error, less the truth's own, and bias: both in units of the truth's mean. Of each pixel what was found, the
/// truth and its standard error.
pub fn off(pixels: impl Iterator<Item = [DVec3; 3]>) -> [f64; 2] {
    let (mut square, mut bias, mut mean, mut count) = (0.0, 0.0, 0.0, 0.0);
    for [found, truth, standard_error] in pixels {
        let error = found - truth;
        square += error.length_squared() - standard_error.length_squared();
        bias += error.element_sum();
        mean += truth.element_sum();
        count += 3.0;
    }
    [f64::sqrt(square / count) / (mean / count), bias / mean]
}
